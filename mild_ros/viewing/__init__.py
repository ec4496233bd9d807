# SPDX-License-Identifier: Apache-2.0
"""Looking at a recorded run: a filmstrip, plots and a 3-D page in one HTML file."""
