# SPDX-License-Identifier: Apache-2.0
"""What the model believes, for people and tools: `std_msgs/Float64MultiArray` with a labelled layout."""

from __future__ import annotations

import array

from mild_core.signals import MotionWindow
from mild_ros.messages.standard import Float64MultiArray, MultiArrayDimension, MultiArrayLayout


def belief_to_msg(motion: MotionWindow) -> Float64MultiArray:
    """The belief (K,) over the components of the interaction, whose name is the label of the one dimension."""
    size = motion.belief.size
    dimension = MultiArrayDimension(label=f"{motion.interaction or 'unknown'} component", size=size, stride=size)
    return Float64MultiArray(
        layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=array.array("d", motion.belief.tobytes())
    )
