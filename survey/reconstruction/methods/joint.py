"""Joint estimate of map and path (joint): points share the errors of the poses they were seen from."""

from survey.core.errors import InputError
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.mean import Mean
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod
from survey.reconstruction.methods.gaussian_process import check_length_scale


def _run(task: MappingTask) -> MappedTerrain:
    from survey.reconstruction.joint.joint_map import JointTerrain

    if task.path is None:
        raise InputError(
            "the joint map needs the error that the points share through their path, and none was given; give a "
            "trajectory with its .error.npz (`path=trajectory.error`), or take the method gp."
        )
    if isinstance(task.prior, Mean):
        raise InputError(
            f"the joint map takes a prior's cells as measurements, and a {type(task.prior).__name__} has none; "
            "give the prior as a Dem or leave it out."
        )
    model = JointTerrain(task.path, task.prior, task.config(GaussianProcessConfig), task.config(JointConfig))
    made = model.map(task.points, task.grid, task.area)
    return MappedTerrain(made.reconstruction, made.correction, solution=made.solution)


JOINT = ReconstructionMethod(
    "joint",
    "Gaussian process and path as one estimate",
    _run,
    {"gp": GaussianProcessConfig, "joint": JointConfig},
    needs_path=True,
    check=check_length_scale,
)
