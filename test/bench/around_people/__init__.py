# SPDX-License-Identifier: Apache-2.0
"""What the bench `people` is made of: kinematic people, scenes with them, the real pipeline in these, and the judge."""
