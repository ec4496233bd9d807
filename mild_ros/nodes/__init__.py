# SPDX-License-Identifier: Apache-2.0
"""The nodes: messages in, the stages' values through, messages out."""
