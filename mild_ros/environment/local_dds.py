# SPDX-License-Identifier: Apache-2.0
"""DDS that stays on this machine: the environment of own processes, whatever the user's says.

Discovery range LOCALHOST alone does not keep out peers that know this machine's address: Fast DDS goes on listening on
every network, and answers a peer that names it in `ROS_STATIC_PEERS`. The profile of `config/fastdds_local.xml` opens
no socket but on 127.0.0.1, and shared memory. Both belong together.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from mild_core.resources import share_folder

FOREIGN = ("ROS_", "RMW_", "RCL_", "RCUTILS_", "FASTDDS_", "FASTRTPS_", "CYCLONEDDS_", "ZENOH_", "NDDS_")
"""Variables that begin so lead a process elsewhere, or to other people's settings; own processes run without them."""

KEPT = ("ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION", "ROS_DOMAIN_ID", "ROS_HOME", "ROS_LOG_DIR")
"""But these, which say where things are."""

PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""As Fast DDS 2 and 3 call it."""

OPTION = "--local"
"""Of every command of `mild`: this one and its children stay on this machine."""


def profile() -> Path:
    """The profile that binds Fast DDS to loopback and shared memory.

    Raises:
        SetupError: The package is not whole.
    """
    beside = Path(__file__).parents[1] / "config"  # of a checkout; what is installed lies with the models
    return (beside if beside.is_dir() else share_folder("config")) / "fastdds_local.xml"


def local_environment(given: Mapping[str, str], domain: int | None = None) -> dict[str, str]:
    """The environment `given`, changed so that DDS stays on this machine.

    Args:
        given: To start from.
        domain: To talk in; None leaves what is given.
    """
    kept = {name: value for name, value in given.items() if name in KEPT or not name.startswith(FOREIGN)}
    kept |= dict.fromkeys(PROFILE_VARIABLES, str(profile()))
    # Without the last, Fast DDS also reads a profile of that name in the current folder.
    kept |= {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "SKIP_DEFAULT_XML_FILE": "1",
    }
    return kept if domain is None else kept | {"ROS_DOMAIN_ID": str(domain)}


def keep_to_this_machine() -> None:
    """Change the environment of this process and of its children to come; before DDS starts in it."""
    local = local_environment(os.environ)
    for name in set(os.environ) - set(local):
        del os.environ[name]
    os.environ.update(local)
