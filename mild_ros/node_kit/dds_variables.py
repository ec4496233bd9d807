# SPDX-License-Identifier: Apache-2.0
"""What environment variables do to DDS, and how each can keep nodes apart: for `mild doctor`."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from mild_core.errors import SetupError

GIVEN_RMW = "MILD_GIVEN_RMW"
"""Set by `./mild` to the user's RMW_IMPLEMENTATION where it takes Fast DDS in its place, the only one it brings."""

PROFILES_HERE = ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml")
"""Files of the current folder that Fast DDS 2 and 3 read unless SKIP_DEFAULT_XML_FILE is set."""

UNNAMED = "a node without a name"
"""A node that is seen, and of which not even the name arrives."""

PAIRED = "pair_"
"""Names of two processes that look for each other begin so."""

RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")

TRANSPORTS = ("DEFAULT", "DEFAULTv6", "SHM", "UDPv4", "UDPv6", "LARGE_DATA", "LARGE_DATAv6", "NONE")
"""Source: Fast DDS 2.14, BuiltinTransports."""

OWN_SERVERS = ("127.0.0.1", "localhost", "0.0.0.0")
DISCOVERY_PORT = 11811
"""Of a discovery server that is named without one. Source: Fast DDS, ROS_DISCOVERY_SERVER."""


LAST_DOMAIN = 232
"""With a higher one DDS ends the process by itself: its ports would be above the last there is."""

DOMAINS_TEXT = f"a number from 0 to 101, or up to {LAST_DOMAIN} where other programs leave its ports alone"
"""What `ROS_DOMAIN_ID` may be. From 102 to 214 Linux hands its ports out to any process."""


@dataclass(frozen=True)
class Variable:
    """An environment variable that matters to DDS.

    Attributes:
        does: What it does, in a few words.
        problem: What is wrong with a value, with what to do after a colon; "" for nothing.
        starts: Whether nodes start with what is wrong all the same.
    """

    does: str
    problem: Callable[[str], str] = lambda value: ""
    starts: bool = True


def _without_server(value: str) -> str:
    """A discovery server on this machine that does not run; what is elsewhere cannot be seen from here."""
    bound = _udp_ports()
    for server in filter(None, value.split(";")):
        host, _, port = server.strip().rpartition(":") if ":" in server else (server.strip(), "", str(DISCOVERY_PORT))
        if host in OWN_SERVERS and port.isdecimal() and int(port) not in bound:
            return f"no server runs at {host}:{port}, so no node hears another: unset it, or start the server"
    return ""


def _udp_ports() -> set[int]:
    """Ports in use on this machine."""
    tables = [Path(name) for name in ("/proc/net/udp", "/proc/net/udp6")]
    lines = [line for table in tables if table.exists() for line in table.read_text().splitlines()[1:]]
    return {int(line.split()[1].rsplit(":", 1)[1], 16) for line in lines}


def _no_range(value: str) -> str:
    if os.environ.get("ROS_LOCALHOST_ONLY") == "1":
        return ""  # it counts more
    if value.upper() == "OFF":
        return "no node finds another: unset it, or set LOCALHOST or SUBNET"
    return "" if value.upper() in RANGES else f"no range: set one of {', '.join(RANGES)}"


def _no_file(value: str) -> str:
    return "" if Path(value).is_file() else "no such file: unset it, or name one that there is"


def _no_profile(value: str) -> str:
    """A file of settings that is not there, or that Fast DDS passes over because it is no XML."""
    if missing := _no_file(value):
        return missing
    try:
        ElementTree.parse(value)
    except (OSError, ElementTree.ParseError) as error:
        return f"cannot be read ({error}), so nothing in it counts: correct it, or unset this"
    return ""


def _no_peer(value: str) -> str:
    """A machine whose address cannot be found: no node starts then."""
    for peer in filter(None, value.split(";")):
        try:
            socket.getaddrinfo(peer, None, socket.AF_INET)
        except (OSError, UnicodeError):
            return f"'{peer}' is no IPv4 address and no name known here, so no node starts: correct it, or unset it"
    return ""


def _no_transports(value: str) -> str:
    """A word that Fast DDS passes over."""
    if value.partition("?")[0] in TRANSPORTS:
        return ""
    return f"Fast DDS knows no such transports and takes its own: set one of {', '.join(TRANSPORTS)}"


def _not_installed(value: str) -> str:
    """An RMW that the ament index does not list."""
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix

    try:
        get_package_prefix(value)
    except (PackageNotFoundError, ValueError, LookupError):
        return "is not installed here: unset it, or install it"
    return ""


def _secured(value: str) -> str:
    if value.lower() != "true":
        return ""
    keys = os.environ.get("ROS_SECURITY_KEYSTORE", "")
    if not Path(keys or "/nonexistent").is_dir():
        return f"there is no keystore ({keys or 'ROS_SECURITY_KEYSTORE is not set'}): unset both, or make one"
    return "nodes need a Fast DDS built with security, which the wheels of ./mild are not"


VARIABLES: Mapping[str, Variable] = {
    "ROS_DISCOVERY_SERVER": Variable("nodes find each other only through the discovery server there", _without_server),
    "ROS_SUPER_CLIENT": Variable("sees all that a discovery server knows"),
    "ROS_STATIC_PEERS": Variable("nodes of these machines are looked for too", _no_peer, starts=False),
    "ROS_LOCALHOST_ONLY": Variable("1 keeps discovery to this machine, whatever the discovery range says; outdated"),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": Variable("how far nodes are looked for", _no_range),
    "RMW_IMPLEMENTATION": Variable("which middleware carries messages; one for all nodes", _not_installed),
    GIVEN_RMW: Variable("your RMW_IMPLEMENTATION; ./mild brings Fast DDS alone and takes that"),
    "FASTRTPS_DEFAULT_PROFILES_FILE": Variable("settings of Fast DDS 2, for transports, networks and QoS", _no_profile),
    "FASTDDS_DEFAULT_PROFILES_FILE": Variable("settings of Fast DDS, for transports, networks and QoS", _no_profile),
    "RMW_FASTRTPS_USE_QOS_FROM_XML": Variable("1 takes QoS from that file rather than from the nodes"),
    "RMW_FASTRTPS_PUBLICATION_MODE": Variable("whether publishers wait for the network"),
    "FASTDDS_BUILTIN_TRANSPORTS": Variable(
        "how messages travel; UDPv4 leaves shared memory out, but not with the discovery range LOCALHOST",
        _no_transports,
    ),
    "FASTDDS_STATISTICS": Variable("Fast DDS publishes figures of its own"),
    "FASTDDS_ENVIRONMENT_FILE": Variable("a file that sets ROS_DISCOVERY_SERVER", _no_file),
    "SKIP_DEFAULT_XML_FILE": Variable("1 leaves settings of the current folder out"),
    "CYCLONEDDS_URI": Variable("settings of Cyclone DDS, which Fast DDS passes over"),
    "ROS_SECURITY_ENABLE": Variable("true lets only nodes with keys start", _secured),
    "ROS_SECURITY_STRATEGY": Variable("Enforce refuses nodes without keys"),
    "ROS_SECURITY_KEYSTORE": Variable("where those keys lie"),
}
"""Every variable that the doctor names when it is set."""

HARMLESS = ("SKIP_DEFAULT_XML_FILE", GIVEN_RMW)
"""Settings that never prevent discovery."""


COMMON = ("rmw_fastrtps_cpp", "SUBNET", "LOCALHOST", "SYSTEM_DEFAULT")
"""Values of every day."""


def given(environment: Mapping[str, str] = os.environ) -> Iterator[tuple[str, str, Variable]]:
    """Variables that are set: name, value and what is known of each."""
    for name, variable in VARIABLES.items():
        if value := environment.get(name):
            yield name, value, variable


def domain_id() -> int:
    """The ROS 2 domain that the environment asks for.

    Raises:
        SetupError: `ROS_DOMAIN_ID` is no domain.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdecimal() and int(domain) <= LAST_DOMAIN):
        raise SetupError("ROS_DOMAIN_ID", f"is '{domain}'", f"set it to {DOMAINS_TEXT}")
    return int(domain)


def profiles_here() -> list[str]:
    """Files of the current folder from which Fast DDS takes settings."""
    return [] if os.environ.get("SKIP_DEFAULT_XML_FILE") else [name for name in PROFILES_HERE if Path(name).is_file()]


def problems() -> dict[str, str]:
    """What is wrong with the variables that are set, with what to do, by name."""
    return {name: problem for name, value, variable in given() if (problem := variable.problem(value))}


def refuse_what_cannot_start() -> None:
    """Before ROS does, in its words.

    Raises:
        SetupError: A variable has a value with which no node starts.
    """
    for name, problem in problems().items():
        if not VARIABLES[name].starts:
            wrong, _, remedy = problem.rpartition(": ")
            raise SetupError(name, wrong, remedy)


def why_alone() -> str:
    """What in the environment may be why no other node is heard: what is wrong there, else what is set; "" for nothing.

    The doctor finds out which of them it is.
    """
    if found := problems():
        return "; ".join(f"{name}: {problem}" for name, problem in found.items())
    changed = [f"{name}={value}" for name, value, _ in given() if name not in HARMLESS and value not in COMMON]
    changed += [f"{name} in this folder" for name in profiles_here()]
    return f"is it {', '.join(changed)}? ./mild doctor tries without" if changed else ""


def heard_remedy(remedy: str) -> str:
    """A remedy for a node that hears no other, and what of the environment may be why: that first, if it is wrong."""
    why = why_alone()
    return "; ".join(filter(None, (why, remedy) if problems() else (remedy, why)))
