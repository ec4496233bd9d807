# SPDX-License-Identifier: Apache-2.0
"""Two machines with a cable between them, made of namespaces of Linux: no privileges needed, none kept.

Run as a program it makes the first machine of the namespaces that it was started in (`unshare --user --map-root-user
--net --uts --mount`), the second one beside it, and runs a command on both at once.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping

from test.ros.processes import ROOT

ADDRESSES = ("10.77.0.1", "10.77.0.2")
NAMESPACES = ("unshare", "--net", "--uts", "--mount", "--kill-child")
SEPARATOR, PATIENCE_S = "\x1f", 180


def cannot_be_made() -> str:
    """Why such machines cannot be made here; "" when it does."""
    for tool in ("unshare", "nsenter", "ip"):
        if shutil.which(tool) is None:
            return f"there is no {tool} here"
    tried = subprocess.run(
        [*NAMESPACES, "--user", "--map-root-user", "ip", "link", "add", "first", "type", "veth"],
        capture_output=True,
        text=True,
        check=False,
    )
    return tried.stderr.strip()


def on_both(commands: tuple[list[str], list[str]], multicast: bool, **environment: str) -> list[str]:
    """What one command prints on the first machine and one on the second; `{peer}` is the other's address."""
    words = [
        sys.executable,
        "-m",
        "test.ros.two_machines",
        "on" if multicast else "off",
        *map(SEPARATOR.join, commands),
    ]
    run = subprocess.run(
        [*NAMESPACES, "--user", "--map-root-user", *words],
        cwd=ROOT,
        env=dict(os.environ, PYTHONPATH=str(ROOT), **environment),  # `./mild test` takes nothing from where it stands
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    return run.stdout.splitlines()


def _shell(*lines: str, inside: tuple[str, ...] = ()) -> None:
    for line in lines:
        subprocess.run([*inside, *line.split()], check=True)


def _process(words: list[str], machine: int, inside: Mapping[str, tuple[str, ...]]) -> subprocess.Popen[str]:
    peer = ADDRESSES[1 - machine]
    environment = {name: value.replace("{peer}", peer) for name, value in os.environ.items()}
    prefix = inside[ADDRESSES[machine]]
    return subprocess.Popen([*prefix, *words], env=environment, stdout=subprocess.PIPE, text=True)


def main(words: list[str]) -> None:
    """Lay the cable, run both commands, print what they print."""
    multicast, *commands = words
    other = subprocess.Popen([*NAMESPACES, "sleep", str(PATIENCE_S)])
    try:
        enter = ("nsenter", f"--target={other.pid}", "--net", "--uts", "--mount")
        while os.readlink(f"/proc/{other.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
            assert other.poll() is None
        inside = {ADDRESSES[0]: (), ADDRESSES[1]: enter}
        _shell(f"ip link add first type veth peer name second netns {other.pid}")
        for name, (address, prefix) in zip(("first", "second"), inside.items(), strict=True):
            # Memory that processes of one machine share is none of the other's.
            _shell("mount -t tmpfs tmpfs /dev/shm", f"hostname {name}", "ip link set lo up", inside=prefix)
            _shell(
                f"ip address add {address}/24 dev {name}", f"ip link set {name} multicast {multicast}", inside=prefix
            )
            # As a machine with a default route has it.
            _shell(f"ip link set {name} up", f"ip route add 224.0.0.0/4 dev {name}", inside=prefix)
        running = [_process(command.split(SEPARATOR), at, inside) for at, command in enumerate(commands)]
        for process in running:
            print(process.communicate(timeout=PATIENCE_S)[0].strip())
    finally:
        other.kill()
        other.wait()


if __name__ == "__main__":
    main(sys.argv[1:])
