# SPDX-License-Identifier: Apache-2.0
"""All that can be chosen about training, as data: the paper's model and the shipped ones differ in nothing else."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from mild_core.inference.manifest import NETWORKS

WARM_UP_EPOCHS = 10
LEAST_RATE = 0.02
"""Share of the learning rate that the last epochs still have."""


@dataclass(frozen=True)
class Architecture:
    """Sizes and wiring of one member. Sources are "window", "label", "context", "controlled" (see `member`).

    Attributes:
        latent: Dimensions of each agent's latent.
        question_coordinates: Principal components of the human's window that networks see; 0: its raw values.
        answer_coordinates: Principal components of the robot's window that networks give; 0: its raw values.
        whitening: 0 divides all components by the deviation of the first, 1 each by its own, between: in between.
        context: Sources of the recurrent encoder of the human's past; empty: none.
        context_hidden: Units before its GRU.
        memory: Units of its GRU.
        encoder: Sources of the human's encoder.
        encoder_hidden: Hidden units by layer, of the human's encoder.
        residual: Sources of what is added to the conditioned latent; empty: nothing is added.
        residual_hidden: Hidden units by layer.
        decoder: Sources of the robot's decoder; "controlled" first.
        decoder_hidden: Hidden units by layer.
        counterpart_hidden: Hidden units of the two networks that only training needs: the robot's encoder and,
            reversed, the human's decoder.
    """

    latent: int = 5
    question_coordinates: int = 20
    answer_coordinates: int = 15
    whitening: float = 0.3
    context: tuple[str, ...] = ("window", "label")
    context_hidden: int = 64
    memory: int = 64
    encoder: tuple[str, ...] = ("context", "window")
    encoder_hidden: tuple[int, ...] = (64,)
    residual: tuple[str, ...] = ("context", "window", "label")
    residual_hidden: tuple[int, ...] = (64,)
    decoder: tuple[str, ...] = ("controlled", "label")
    decoder_hidden: tuple[int, ...] = (64,)
    counterpart_hidden: tuple[int, ...] = (64,)

    def __post_init__(self) -> None:
        for name, ways in NETWORKS.items():
            sources = getattr(self, name, ())
            if sources and sources not in ways:
                known = " or ".join(str(list(way)) for way in ways)
                raise ValueError(f"{name} takes in {known}, not {list(sources)}")
        if ("context" in self.encoder) != bool(self.context) or (self.residual and not self.context):
            raise ValueError("encoder and residual take in the context where there is one, and only there")


@dataclass(frozen=True)
class Augmentation:
    """How far a trial is bent each time that it is learned from: what another person might have done as well.

    Attributes:
        copies: Of each trial in an epoch.
        speed: Overall speed, uniform: logarithm within plus or minus this.
        unsteadiness: Deviation of the logarithm of the speed at `knots` points of the trial.
        knots: Number of these points.
        arm_scale: Length of the human's arm, uniform: share within plus or minus this.
        yaw_rad: Rotation of the human about the vertical, uniform within plus or minus this [rad].
        offset_m: Deviation of a constant offset of every joint of the human [m].
    """

    copies: int = 2
    speed: float = 0.2
    unsteadiness: float = 0.15
    knots: int = 6
    arm_scale: float = 0.1
    yaw_rad: float = 0.15
    offset_m: float = 0.01


@dataclass(frozen=True)
class Paired:
    """How far the people differ who repeat trials, see `paired`. Lengths are in arm lengths.

    Attributes:
        copies: Of each trial.
        share: Of what is learned from in an epoch that is one of these, the rest being as recorded.
        least: How far the place where the hand is held out moves at least: forward, left, up.
        most: And at most.
        scale: Range of the factor of the hand's way from its rest.
        yaw_rad: Largest turn of the body.
        style: Deviation of a slow random wander of hand and elbow.
        speed: Range of the factor of both agents' speed.
    """

    copies: int = 8
    share: float = 0.3
    least: tuple[float, ...] = (-0.3, -0.4, -0.3)
    most: tuple[float, ...] = (0.6, 0.4, 0.6)
    scale: tuple[float, ...] = (0.8, 1.25)
    yaw_rad: float = 0.3
    style: float = 0.03
    speed: tuple[float, ...] = (0.85, 1.6)

    def __post_init__(self) -> None:
        if not (self.copies > 0 and 0.0 < self.share <= 1.0):
            raise ValueError("copies must be at least 1, share above 0 and at most 1")
        if len(self.least) != 3 or len(self.most) != 3:
            raise ValueError("least and most are three numbers each: forward, left, up")
        for pair, lowest in ((self.scale, 0.0), (self.speed, 0.1)):
            if len(pair) != 2 or not lowest < pair[0] <= pair[1]:
                raise ValueError("scale and speed are a least and a most, above 0, of speed above 0.1")


@dataclass(frozen=True)
class LossWeights:
    """Weights of the terms of the objective.

    Attributes:
        prediction: Error of the robot's window through belief, conditioning and decoder.
        observed: Reconstruction of the human's window.
        controlled: Reconstruction of the robot's window.
        divergence: beta, of both posteriors from the prior.
    """

    prediction: float = 1.0
    observed: float = 0.3
    controlled: float = 0.3
    divergence: float = 1e-3


@dataclass(frozen=True)
class PriorSettings:
    """The prior of each interaction and its re-estimation between epochs.

    Attributes:
        kind: Name in `inference.priors.PRIORS`.
        components: K.
        covariance_fraction: Share of the latents' variance added to every covariance.
        iterations: Of expectation maximisation each time.
        every: Epochs between two times.
        frozen_from: Share of the epochs after which it stays as it is.
    """

    kind: str = "hsmm"
    components: int = 5
    covariance_fraction: float = 0.1
    iterations: int = 3
    every: int = 2
    frozen_from: float = 0.5


@dataclass(frozen=True)
class RecogniserSettings:
    """The network that classifies the interaction, see `recogniser`.

    Attributes:
        question_coordinates: Principal components of the human's window that it sees.
        whitening: See `Architecture`.
        hidden: Hidden units by layer.
        dropout: Share of the values dropped after each hidden layer.
        learning_rate: Of AdamW, falling to zero like a cosine.
        epochs: Of its own, for each of the other networks'.
    """

    question_coordinates: int = 30
    whitening: float = 0.5
    hidden: tuple[int, ...] = (64, 64)
    dropout: float = 0.2
    learning_rate: float = 3e-3
    epochs: float = 0.8


@dataclass(frozen=True)
class ReservoirSettings:
    """The reservoir beside the members, see `reservoir`.

    Attributes:
        share: That its answer has, the members together having the rest.
        count: Of reservoirs whose answers are averaged.
        units: Of each.
        sources: Units that each unit listens to.
        gain: Spectral radius of what it hears from them; well above 1 the units would not forget.
        input_scale: Deviation of the weights of a frame's values, these being of deviation 1.
        velocity_weight_s: What a velocity of a metre per second counts beside a position of a metre.
        time_constants_s: Shortest and longest of the units' memory.
        copies: Of each trial, bent, that are learned from beside the recorded one.
    """

    share: float = 0.5
    count: int = 3
    units: int = 300
    sources: int = 10
    gain: float = 1.3
    input_scale: float = 0.2
    velocity_weight_s: float = 0.3
    time_constants_s: tuple[float, ...] = (0.06, 5.0)
    copies: int = 0

    def __post_init__(self) -> None:
        if not (0.0 < self.share <= 1.0 and min(self.count, self.units, self.sources) > 0):
            raise ValueError("share must be above 0 and at most 1, count, units and sources at least 1")
        if len(self.time_constants_s) != 2 or not 0.0 < self.time_constants_s[0] <= self.time_constants_s[1]:
            raise ValueError("time_constants_s are the shortest and the longest, above 0")


@dataclass(frozen=True)
class TrainingSettings:
    """One way to train.

    Attributes:
        architecture: Sizes and wiring.
        prior: The prior and its re-estimation.
        weights: Of the objective's terms.
        augmentation: None: trials as recorded.
        paired: None: by the recorded people only.
        recogniser: None: the reservoir alone classifies the interaction; without one, the priors' likelihoods do.
        reservoir: None: the members answer alone.
        start_pose: Whether a start pose correction is learned, see `start_pose`; needs a reservoir.
        stride: S: belief and memory see every S-th window; durations count in steps of S frames.
        gradient_stride: Windows between two that are learned from; `stride` where a gradient passes memory or belief.
        epochs: Number of passes over all trials.
        observed_share: The first share of the epochs trains the human's networks alone; then the robot's start from
            the human's hidden layers of equal size.
        batch_trials: Trials (or augmented copies) for one step of the optimiser.
        learning_rate: Of AdamW; it warms up over ten epochs and then falls to zero like a cosine.
        weight_decay: Of AdamW.
        largest_gradient: The norm of the gradient is cut to this.
        dropout: Share of the values dropped in the context, encoder and residual networks.
        samples: Posterior samples decoded for each window.
        averaging: Share that the running average of the weights keeps at each epoch once the prior is frozen; 0: the
            last weights are taken.
        members: Networks trained from different seeds, whose answers are averaged.
        evidence_per_s: Windows per second that recognition counts in full.
        evidence_kept_per_s: Share of what recognition has seen that still counts a second later.
        doublings: How often `epochs` is halved for the first of the trainings that find out how many epochs are
            enough, see `stopping`; 0: it is `epochs`.
    """

    architecture: Architecture = field(default_factory=Architecture)
    prior: PriorSettings = field(default_factory=PriorSettings)
    weights: LossWeights = field(default_factory=LossWeights)
    augmentation: Augmentation | None = field(default_factory=Augmentation)
    paired: Paired | None = None
    recogniser: RecogniserSettings | None = field(default_factory=RecogniserSettings)
    reservoir: ReservoirSettings | None = field(default_factory=ReservoirSettings)
    start_pose: bool = True
    stride: int = 16
    gradient_stride: int = 16
    epochs: int = 360
    observed_share: float = 0.0
    batch_trials: int = 16
    learning_rate: float = 4.5e-3
    weight_decay: float = 1e-2
    largest_gradient: float = 1.0
    dropout: float = 0.3
    samples: int = 1
    averaging: float = 0.97
    members: int = 1
    evidence_per_s: float = 4.0
    evidence_kept_per_s: float = 0.67
    doublings: int = 0

    def __post_init__(self) -> None:
        through = self.weights.prediction > 0.0 or bool(self.architecture.context)
        if through and self.gradient_stride != self.stride:
            raise ValueError("a gradient through memory or belief needs every window of a stride: equal strides")
        if not (self.evidence_per_s > 0.0 and 0.0 < self.evidence_kept_per_s <= 1.0):
            raise ValueError("evidence_per_s must be above 0, evidence_kept_per_s above 0 and at most 1")
        if self.doublings < 0 or self.epochs < 1:
            raise ValueError("doublings must be 0 or more, epochs at least 1")
        if not 0.0 <= self.observed_share < 1.0:
            raise ValueError("observed_share must be at least 0 and below 1: the robot's networks need epochs too")
        if self.start_pose and self.reservoir is None:
            raise ValueError("start_pose is learned from what a reservoir errs in, and there is none: reservoir = true")

    @property
    def observed_epochs(self) -> int:
        """Number of epochs that train the human's networks alone; at least one is left for the robot's."""
        return min(round(self.observed_share * self.epochs), self.epochs - 1)

    def learning_rate_in(self, epoch: int) -> float:
        """That of the optimiser in an epoch, counted from 0."""
        falling = 0.5 * (1.0 + math.cos(math.pi * epoch / self.epochs)) + LEAST_RATE
        return self.learning_rate * (min(1.0, (epoch + 1) / WARM_UP_EPOCHS) * falling)
