# SPDX-License-Identifier: Apache-2.0
"""Recordings and trials: files of any origin in, checked demonstrations cut into windows out."""
