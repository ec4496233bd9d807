# SPDX-License-Identifier: Apache-2.0
"""The command `mild`, called as its main function calls it."""
