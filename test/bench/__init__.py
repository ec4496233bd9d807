# SPDX-License-Identifier: Apache-2.0
"""The benches behind the figures that the documents print: one module each, with a `main()` that reads the arguments.

`./mild measure NAME` runs them. `main` ends with a non-zero exit code, or returns one, where something is wrong.
"""

from __future__ import annotations

from typing import NamedTuple


class Bench(NamedTuple):
    """One bench as people read of it; its name is that of its module.

    Attributes:
        summary: What it measures, in one sentence.
        minutes: How long it takes with its defaults on two cores, about.
        needs: What it needs besides the set-up, empty for nothing.
    """

    summary: str
    minutes: float
    needs: str = ""


BENCHES = {
    "bag_faults": Bench(
        "Damages ten thousand bags at random and opens each: read, refused in one line, or salvaged.", 20
    ),
    "carry_over": Bench(
        "Errors of networks that start from the hidden layers of other people's, beside those that do not.",
        *(20, "traj_data.npz of three recordings in $MILD_DATA"),
    ),
    "command_age": Bench("Age of a command: from a skeleton's stamp to the arrival of its JointState, over DDS.", 1),
    "command_gaps": Bench("Gaps between commands while each topic is flooded at 5 kHz.", 10),
    "contact": Bench(
        "Distance between the person's and the simulated robot's hand, per interaction and kind of inverse kinematics.",
        *(10, "traj_data.npz in $MILD_DATA for recorded trials"),
    ),
    "em_iteration": Bench("Processor time of one EM iteration of the prior, beside the same in plain torch loops.", 1),
    "hostile_files": Bench(
        "Opens files that are made to exhaust memory, time or disk: each refused within its budget.", 3
    ),
    "mutations": Bench("Plants faults in copies of the code, one at a time, and lists what no quick test notices.", 45),
    "people": Bench("Distances and speeds of the robot near people, judged by bodies that are not the guard's.", 25),
    "pepper_contact": Bench("Draws how Pepper and a person shake hands, as a picture or a page.", 1),
    "perception_figures": Bench(
        "Outcomes of perception on recordings of real trackers.",
        *(1, "recordings in $MILD_DATA and bags in $MILD_BAGS"),
    ),
    "perception_latency": Bench("Processor time of one skeleton message in perception.", 0.5),
    "retargeting_tick": Bench("Processor time of one tick of retargeting, per robot and part.", 1),
    "segmentation": Bench(
        "One HSMM over all interactions beside one for each: purity, cuts and labels of long recordings, predictions.",
        *(12, "traj_data.npz in $MILD_DATA"),
    ),
    "soak": Bench("Random people, interactions and faults for half an hour of simulated time: limits and memory.", 4),
    "speed_near_people": Bench("Speed of every link near people, over a million ticks.", 30),
    "step_latency": Bench("Latency of one step of inference.", 0.5),
    "walkers": Bench("Distances of people who walk through a greeting at random, by the same judge.", 8),
}
"""The name of each is the name of its module in this package."""
