# SPDX-License-Identifier: Apache-2.0
"""Stages made from parameters and a model folder: nodes and replay in process make the same ones, one file each."""
