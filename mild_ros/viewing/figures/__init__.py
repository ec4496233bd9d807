# SPDX-License-Identifier: Apache-2.0
"""Figures for papers and model cards: plain data in, a file out, one look for all."""
