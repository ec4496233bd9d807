# SPDX-License-Identifier: Apache-2.0
"""How much processor time one iteration of expectation maximisation takes: `python -m test.bench.em_iteration`.

The size is METHOD's: 38 demonstrations of 600 frames, a 10-D latent, 10 components, durations up to 100 frames.
"""

from __future__ import annotations

from time import process_time

import numpy as np

from mild_core.inference.priors import HSMM
from mild_core.inference.priors.prior import FitSettings

DEMONSTRATIONS, FRAMES, LATENT, COMPONENTS, LONGEST = 38, 600, 10, 10, 100


def measure(repeats: int = 15) -> np.ndarray:
    """Milliseconds of each iteration, after a first one that compiles."""
    rng = np.random.default_rng(0)
    means = rng.normal(0.0, 3.0, (COMPONENTS, LATENT))
    path = np.arange(FRAMES) * COMPONENTS // FRAMES
    latents = [means[path] + rng.normal(size=(FRAMES, LATENT)) for _ in range(DEMONSTRATIONS)]
    prior = HSMM.from_demonstrations(latents, COMPONENTS, LATENT // 2)
    arrays = dict(prior.to_arrays())
    arrays["durations"] = np.full((COMPONENTS, LONGEST), 1.0 / LONGEST)
    prior = HSMM.from_arrays(arrays, LATENT // 2)
    one = FitSettings(iterations=1)
    prior.fit(latents, one)
    milliseconds = []
    for _ in range(repeats):
        start = process_time()
        prior.fit(latents, one)
        # A fit of one iteration weighs the latents twice: before and after.
        fitted = process_time()
        prior.expect(latents)
        milliseconds.append(1e3 * (fitted - start - (process_time() - fitted)))
    return np.array(milliseconds)


if __name__ == "__main__":
    times = measure()
    print(f"one EM iteration: median {np.median(times):.1f} ms, best {times.min():.1f} ms of {len(times)}")
