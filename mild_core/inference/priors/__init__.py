# SPDX-License-Identifier: Apache-2.0
"""Priors over the joint latent of both agents: one file per member, behind the contract in `prior.py`."""

from mild_core.inference.priors.gmm import GMM
from mild_core.inference.priors.hmm import HMM
from mild_core.inference.priors.hsmm import HSMM
from mild_core.inference.priors.prior import Prior

PRIORS: dict[str, type[Prior]] = {"gmm": GMM, "hmm": HMM, "hsmm": HSMM}
