"""Public names and the modules that define them."""

from survey.interchange.conversion import convert as convert
from survey.interchange.drive_bags import write_bag as write_bag
from survey.interchange.layouts import write_euroc as write_euroc
from survey.interchange.layouts import write_kitti_sequence as write_kitti_sequence
from survey.interchange.route_formats import read_plan as read_plan
from survey.interchange.route_formats import write_plan as write_plan
from survey.io.trajectory_files import read_kitti as read_kitti
