# SPDX-License-Identifier: Apache-2.0
"""From a person's feature window to the robot's next motion window: encode, update the belief, condition, decode."""
