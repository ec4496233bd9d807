# SPDX-License-Identifier: Apache-2.0
"""The habits of the codebase as gates, each shown to reject a planted violation."""
