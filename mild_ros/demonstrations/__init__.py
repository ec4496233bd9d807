# SPDX-License-Identifier: Apache-2.0
"""From recorded bags to what two agents did, on one clock: what trials are cut out of."""
