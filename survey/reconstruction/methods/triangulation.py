"""Linear interpolation in Delaunay triangles (tin)."""

from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod


def _run(task: MappingTask) -> MappedTerrain:
    from survey.reconstruction.triangulation import triangulate

    return MappedTerrain(triangulate(task.points, task.grid, quantity=task.quantity))


TIN = ReconstructionMethod(
    "tin", "linear interpolation in Delaunay triangles", _run, uses_prior=False, maps_values=True
)
