"""Contents of an MJCF model: elements, frames, drives, ranges, inertia, accuracy."""

from sim.mjcf.drive import Drive as Drive
from sim.mjcf.drive import Law as Law
from sim.mjcf.drive import drive_rows as drive_rows
from sim.mjcf.drive import drives as drives
from sim.mjcf.drive import law_of as law_of
from sim.mjcf.drive import names_of as names_of
from sim.mjcf.drive import number_of as number_of
from sim.mjcf.frame import located as located
from sim.mjcf.frame import one_half_turn as one_half_turn
from sim.mjcf.joints import joint_positions as joint_positions
from sim.mjcf.joints import joint_stiffness as joint_stiffness
from sim.mjcf.joints import mass_matrix as mass_matrix
from sim.mjcf.joints import one_axis as one_axis
from sim.mjcf.limits import Coupled as Coupled
from sim.mjcf.load import model_sha256 as model_sha256
from sim.mjcf.model import element_id as element_id
from sim.mjcf.model import joint_name as joint_name
from sim.mjcf.model import listed as listed
from sim.mjcf.model import name_of as name_of
from sim.mjcf.model import start_of as start_of
from sim.mjcf.model import weightless as weightless
from sim.mjcf.part import Part as Part
