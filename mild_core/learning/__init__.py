# SPDX-License-Identifier: Apache-2.0
"""From demonstrations to model folders, and how good they are: the only package that may import torch."""
