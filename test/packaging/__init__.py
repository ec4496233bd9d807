# SPDX-License-Identifier: Apache-2.0
"""The package as others get it: from pip, from colcon, from `./mild`."""
