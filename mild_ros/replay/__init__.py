# SPDX-License-Identifier: Apache-2.0
"""A recorded bag through the pipeline, or to the nodes: a bag in, the same commands out every time."""
