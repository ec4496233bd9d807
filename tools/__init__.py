# SPDX-License-Identifier: Apache-2.0
"""What makes files of this repository: scenes, robot descriptions, tables of the documents. Not installed."""
