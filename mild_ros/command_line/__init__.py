# SPDX-License-Identifier: Apache-2.0
"""The commands of `mild`: one file each. Only here may the shell import mild_core.learning."""
