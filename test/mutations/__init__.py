# SPDX-License-Identifier: Apache-2.0
"""Faults that the quick tests have to notice: what `./mild measure mutations` plants, one at a time.

One file per area, each with a tuple FAULTS. A change of the code carries the faults along: a default test fails
where the old text of one does not stand exactly once in its file.
"""

from __future__ import annotations

from test.mutations import doubts, inference, learning, people, perception, retargeting, shell, strangers
from test.mutations.fault import Fault

AREAS: dict[str, tuple[Fault, ...]] = {
    module.__name__.rpartition(".")[2]: module.FAULTS
    for module in (perception, inference, learning, retargeting, people, doubts, shell, strangers)
}
"""Faults by the file of this package that lists them."""

FAULTS: tuple[Fault, ...] = tuple(fault for faults in AREAS.values() for fault in faults)
