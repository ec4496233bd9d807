# SPDX-License-Identifier: Apache-2.0
"""A member in training as a value: all that an epoch changes. Who has it goes on as if nothing had come between.

Draws depend on seed, member and epoch alone (`training.drawing_from`), so no generator's state is part of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from mild_core.inference.priors import PRIORS
from mild_core.inference.priors.prior import Prior
from mild_core.learning.training.latent_prior import LatentPrior, latent_prior
from mild_core.learning.training.settings import TrainingSettings
from mild_core.learning.training.vae import MemberNetworks


@dataclass(frozen=True, eq=False)
class FittedPriors:
    """The priors of all interactions as they were estimated last.

    Attributes:
        by_name: In the order of the labels.
        widening: See `latent_prior`.
        steps: See `latent_prior`.
    """

    by_name: Mapping[str, Prior]
    widening: tuple[Tensor, Tensor]
    steps: int

    @cached_property
    def latent(self) -> LatentPrior:
        """As the objective takes them."""
        return latent_prior(self.by_name, self.widening, self.steps)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A member between two epochs.

    Attributes:
        epochs: How many are done.
        steps: Of the priors' component paths; 0 without priors.
        tensors: By name. They are those that are being trained: save or copy them before the next epoch.
    """

    epochs: int
    steps: int
    tensors: Mapping[str, Tensor]


@dataclass(eq=False)
class Learner:
    """A member in training.

    Attributes:
        networks: All of them.
        optimiser: Of their parameters.
        carried: Layers that it started with from another model, as `network.layer`.
        fitted: None before the first estimate.
        average: Running average of the weights; empty before there is one.
        epochs: How many are done.
        validation: Errors on held-out trials after each, where some are held out.
    """

    networks: MemberNetworks
    optimiser: torch.optim.Optimizer
    carried: tuple[str, ...] = ()
    fitted: FittedPriors | None = None
    average: dict[str, Tensor] = field(default_factory=dict)
    epochs: int = 0
    validation: list[float] = field(default_factory=list)

    @property
    def prior(self) -> LatentPrior | None:
        """As the objective takes it."""
        return None if self.fitted is None else self.fitted.latent

    def average_in(self, keep: float) -> None:
        """Move the running average of all weights on, keeping that share of it."""
        now = {name: value.detach().clone() for name, value in self.networks.state_dict().items()}
        before = self.average or now
        self.average = {name: torch.lerp(now[name], value, keep) for name, value in before.items()}

    def snapshot(self) -> Snapshot:
        """What to go on from."""
        tensors = {f"networks/{name}": value for name, value in self.networks.state_dict().items()}
        for number, moments in self.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser/{number}/{name}": value for name, value in moments.items()}
        tensors |= {f"average/{name}": value for name, value in self.average.items()}
        tensors |= {"validation/errors": torch.tensor(self.validation, dtype=torch.float64)} if self.validation else {}
        if self.fitted is None:
            return Snapshot(self.epochs, 0, tensors)
        for place, prior in enumerate(self.fitted.by_name.values()):
            tensors |= {f"prior/{place}/{name}": torch.tensor(a) for name, a in prior.to_arrays().items()}
        tensors |= {f"widening/{place}": value for place, value in enumerate(self.fitted.widening)}
        return Snapshot(self.epochs, self.fitted.steps, tensors)

    def go_on_from(self, snapshot: Snapshot, settings: TrainingSettings, interactions: Sequence[str]) -> None:
        """Become what `snapshot` was taken of.

        Raises:
            ValueError, KeyError, RuntimeError: It was taken of something else.
        """
        parts: dict[str, dict[str, Tensor]] = {}
        for name, value in snapshot.tensors.items():
            part, _, rest = name.partition("/")
            parts.setdefault(part, {})[rest] = value.clone()
        self.networks.load_state_dict(parts["networks"])
        moments: dict[int, dict[str, Tensor]] = {}
        for name, value in parts.get("optimiser", {}).items():
            number, _, what = name.partition("/")
            moments.setdefault(int(number), {})[what] = value
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": moments, "param_groups": groups})
        self.average, self.epochs = parts.get("average", {}), snapshot.epochs
        self.validation = parts["validation"]["errors"].tolist() if "validation" in parts else []
        if snapshot.steps:
            arrays: dict[str, dict[str, np.ndarray]] = {}
            for name, value in parts["prior"].items():
                place, _, what = name.partition("/")
                arrays.setdefault(place, {})[what] = value.numpy()
            kind, size = PRIORS[settings.prior.kind], settings.architecture.latent
            priors = {name: kind.from_arrays(arrays[str(place)], size) for place, name in enumerate(interactions)}
            self.fitted = FittedPriors(priors, (parts["widening"]["0"], parts["widening"]["1"]), snapshot.steps)
