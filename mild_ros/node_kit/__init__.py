# SPDX-License-Identifier: Apache-2.0
"""What every node is made of: parameters, clock, diagnostics, reception, start and end."""
