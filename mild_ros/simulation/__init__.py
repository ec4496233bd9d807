# SPDX-License-Identifier: Apache-2.0
"""The robot and the person who are not there: physics behind one contract, and a kinematic human."""
