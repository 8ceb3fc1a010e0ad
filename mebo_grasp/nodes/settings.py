"""The parameters of the three nodes; ``params/*.yaml`` shows the same, and a test compares them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.trial import CONTACT_MODELS, QUALITY_NAMES
from mebo_grasp.nodes.parameters import parameter
from mebo_grasp.optimization.methods.base import (
    DEFAULT_INPUT_SD,
    DEFAULT_METHOD,
    KERNEL_NAMES,
    LEARNING_NAMES,
    SURROGATE_NAMES,
    WARP_NAMES,
)
from mebo_grasp.solutions.blocking import BlockingRule

LARGEST_ANSWER = 10_000
"""Grasps that the solution set node sends at once: a million of them, and their distances, would fill the memory."""

OCCLUSION_RULES = tuple(rule.value for rule in BlockingRule)


@dataclass(frozen=True)
class HandNodeSettings:
    """Parameters of ``hand_node``."""

    object: str = parameter("bottle", "target object: a built-in name or the path of a mesh file")
    object_scale: float = parameter(
        1.0, "factor from the mesh file's unit to metres (0.001 for millimetres)", least=1e-9, most=1e9
    )
    object_concave: str = parameter(
        "surface", "what stands for a concave mesh: surface (exact), or parts (convex ones, by coacd)"
    )
    hand: str = parameter("icub_left", "hand: a built-in name or the path of a hand description (YAML)")
    hand_namespace: str = parameter(
        "", "prefix of this hand's own topics (candidate_pose, joint_states, …); empty for none"
    )
    friction: float = parameter(0.5, "coefficient of static friction", least=0.0, most=10.0)
    cone_edges: int = parameter(8, "edges of the friction pyramid", least=3, most=64)
    contact_model: str = parameter("hard", f"what a contact transmits: {', '.join(CONTACT_MODELS)}")
    quality: str = parameter("epsilon", f"metric that is optimized: {', '.join(QUALITY_NAMES)}")
    engine: str = parameter("bullet", "engine of the simulation: bullet (reference) or fast (compiled)")
    position_noise: float = parameter(
        0.0, "standard deviation of each coordinate of the executed position [m]; 0: exact", least=0.0, most=1.0
    )
    rotation_noise: float = parameter(
        0.0, "standard deviation of each component of the executed turn [rad]; 0: exact", least=0.0, most=3.0
    )
    friction_noise: float = parameter(
        0.0, "standard deviation of the coefficient of friction from trial to trial", least=0.0, most=10.0
    )
    normal_noise: float = parameter(
        0.0, "standard deviation of the tilt of contact normals, about two axes [rad]", least=0.0, most=1.5
    )
    noise_seed: int = parameter(1, "seed of these noises, which are drawn trial by trial", least=0)
    repetitions: int = parameter(
        0,
        "further executions of a grasp with these noises: tells its expected, sd and worst quality; 0: none",
        least=0,
        most=10_000,
    )
    expects_posture: bool = parameter(
        False, "whether a candidate_posture of the same stamp belongs to every candidate_pose (space pose_posture)"
    )
    posture_timeout: float = parameter(
        1.0, "seconds that one of them waits for the other; then the trial is answered as FAILED", least=0.01, most=60.0
    )
    marker_rate: float = parameter(5.0, "most markers per second [Hz]; 0 for none", least=0.0, most=100.0)


@dataclass(frozen=True)
class OptimizerNodeSettings:
    """Parameters of ``optimizer_node``."""

    object: str = parameter("bottle", "target object: a built-in name or the path of a mesh file")
    object_scale: float = parameter(
        1.0, "factor from the mesh file's unit to metres (0.001 for millimetres)", least=1e-9, most=1e9
    )
    hand: str = parameter("icub_left", "hand: a built-in name or the path of a hand description (YAML)")
    space: str = parameter(
        "position",
        "search space: position (3-D, fixed orientation), pose (6-D), pose_posture (6-D and amplitudes of synergies) "
        "or facet (6-D, about a facet)",
    )
    synergies: int = parameter(2, "amplitudes of the hand's synergies in space pose_posture", least=1, most=100)
    facet: str = parameter("+y", "facet of the object's box that the hand faces in space facet: +x, -x, +y, -y, +z, -z")
    lower_bounds: tuple[float, ...] = parameter(
        (), "lower bounds of the search space [m, rad]; empty: derived from the object's box"
    )
    upper_bounds: tuple[float, ...] = parameter(
        (), "upper bounds of the search space [m, rad]; empty: derived from the object's box"
    )
    method: str = parameter(DEFAULT_METHOD, "name of the optimization method")
    seed: int = parameter(1, "seed of the random generator", least=0)
    budget: int = parameter(250, "number of trials", least=1, most=1_000_000)
    initial_points: int = parameter(25, "trials of the initial Latin hypercube", least=1, most=100_000)
    batch_size: int = parameter(3, "trials chosen at once", least=1, most=1000)
    ucb_beta: float = parameter(2.0, "weight of the standard deviation in UCB", least=0.0, most=100.0)
    boltzmann_beta: float = parameter(
        3.0, "inverse temperature of Boltzmann selection on the standardized acquisition", least=0.0, most=1e6
    )
    burn_in: int = parameter(250, "Metropolis-Hastings steps discarded, per dimension", least=1, most=1_000_000)
    relearn_period: int = parameter(5, "iterations between two learnings of the hyperparameters", least=1)
    kernel: str = parameter(
        KERNEL_NAMES[0], f"covariance of all methods but {DEFAULT_METHOD}: {', '.join(KERNEL_NAMES)}"
    )
    warp: str = parameter(WARP_NAMES[0], f"learned map of each input before the kernel: {', '.join(WARP_NAMES)}")
    learning: str = parameter(LEARNING_NAMES[0], f"how the hyperparameters are learned: {', '.join(LEARNING_NAMES)}")
    surrogate: str = parameter(
        SURROGATE_NAMES[0], f"surrogate of all methods but {DEFAULT_METHOD}: {', '.join(SURROGATE_NAMES)}"
    )
    min_leaf: int = parameter(20, "observations of a region of surrogate treed_gp, at least", least=2)
    particles: int = parameter(10, "draws of the hyperparameters for learning mcmc", least=1, most=1000)
    safe: bool = parameter(False, "choose trials and solutions by what is expected of them under input noise")
    input_noise: float = parameter(
        DEFAULT_INPUT_SD, "deviation of the executed from the chosen point, in sides of the search box", least=0.0
    )
    input_noise_position: float = parameter(
        0.0, "the same as lengths [m]; if this or the rotation's is above 0, these two count", least=0.0
    )
    input_noise_rotation: float = parameter(0.0, "the same as angles [rad]", least=0.0)
    num_solutions: int = parameter(0, "number of solutions wanted, for methods that use it; 0: free", least=0)
    min_distance: float = parameter(0.0, "least distance of two solutions [m + weighted rad]; 0: free", least=0.0)
    rotation_weight: float = parameter(
        0.05, "metres that one radian of rotation counts in the distance of two solutions", least=0.0
    )
    hands: tuple[str, ...] = parameter(("",), "namespaces of the hands; a candidate goes to <hand>/candidate_pose")
    trials_per_hand: int = parameter(2, "candidates in flight for each hand", least=1, most=100)
    trial_timeout: float = parameter(5.0, "seconds until a silent hand's trial is given again", least=0.05)
    max_attempts: int = parameter(5, "times a trial is given before it counts as failed", least=1, most=1000)
    autostart: bool = parameter(True, "begin to explore at once, without the start service")
    run_log: str = parameter("", "file that a killed run resumes from; empty: none")
    listen_to_others: bool = parameter(True, "learn from trials that another optimizer asked for")

    def __post_init__(self) -> None:
        if self.initial_points > self.budget:
            raise InvalidSettingsError(
                f"initial_points is {self.initial_points} but budget is {self.budget}: "
                "give a budget of at least the initial points"
            )
        if len(set(self.hands)) != len(self.hands) or not self.hands:
            raise InvalidSettingsError(f"hands must be one or more different namespaces, got {list(self.hands)}")
        if len(self.lower_bounds) != len(self.upper_bounds):
            raise InvalidSettingsError(
                f"lower_bounds has {len(self.lower_bounds)} values and upper_bounds "
                f"{len(self.upper_bounds)}: give both, or neither"
            )


@dataclass(frozen=True)
class SolutionSetNodeSettings:
    """Parameters of ``solution_set_node``."""

    object: str = parameter("bottle", "target object: a built-in name or the path of a mesh file")
    database: str = parameter("", "SQLite file of all trials; empty: <ROS home>/mebo_grasp/<object>.db")
    sync_each_trial: bool = parameter(
        False, "wait for the disk at each trial, so that a loss of power loses none either"
    )
    size: int = parameter(4, "grasps kept in the solution set", least=1, most=LARGEST_ANSWER)
    min_distance: float = parameter(0.04, "least distance of two grasps of the set [m + weighted rad]", least=0.0)
    rotation_weight: float = parameter(
        0.05, "metres that one radian of rotation counts in the distance of two grasps", least=0.0
    )
    symmetry_axis: tuple[float, ...] = parameter(
        (), "direction of the axis about which the object looks the same from all sides; empty: none"
    )
    occlusion_rule: str = parameter(
        "hand", "when a grasp is blocked: hand (its volume or approach meets an occlusion) or tcp (its TCP does)"
    )
    hand: str = parameter(
        "icub_left", "hand whose volume counts where a trial names no built-in one: a name or a description"
    )
    approach_length: float = parameter(
        0.1, "length of the straight path of the TCP to a grasp [m]; 0: none", least=0.0, most=10.0
    )
    approach_axis: tuple[float, ...] = parameter(
        (), "direction in which the TCP arrives, in its own frame; empty: that of the hand"
    )
    occlusion_margin: float = parameter(
        0.0, "metres by which every occlusion is thickened, beside its own margin", least=0.0, most=10.0
    )
    static_transforms: tuple[str, ...] = parameter(
        (), "frames of occlusions, each as 'parent child x y z qx qy qz qw' [m, xyzw]; /tf_static is heard too"
    )
    publish_rate: float = parameter(10.0, "most updates of solution_set per second [Hz]", least=0.1, most=1000.0)
    marker_rate: float = parameter(2.0, "most updates of solution_markers per second [Hz]", least=0.1, most=100.0)

    def __post_init__(self) -> None:
        if self.occlusion_rule not in OCCLUSION_RULES:
            raise InvalidSettingsError(
                f"occlusion_rule is '{self.occlusion_rule}', known are {', '.join(OCCLUSION_RULES)}"
            )
        for name in ("symmetry_axis", "approach_axis"):
            axis = getattr(self, name)
            if axis and not (len(axis) == 3 and all(map(math.isfinite, axis)) and any(axis)):
                raise InvalidSettingsError(
                    f"{name} must be three finite numbers, not all 0, or empty; got {list(axis)}"
                )
