"""Argument checks of all rooms: wrong input raises at once, in one sentence.

It names the argument, what it must be and what came. Every check returns the argument in the form
that the caller computes with. Made for use as `import argument_checks as check`.
"""

from argument_checks.arrays import LARGEST as LARGEST
from argument_checks.arrays import SMALLEST as SMALLEST
from argument_checks.arrays import Array as Array
from argument_checks.arrays import Indices as Indices
from argument_checks.arrays import Mask as Mask
from argument_checks.arrays import all_positive as all_positive
from argument_checks.arrays import common_axes as common_axes
from argument_checks.arrays import exactly as exactly
from argument_checks.arrays import finite as finite
from argument_checks.arrays import flat as flat
from argument_checks.arrays import frozen as frozen
from argument_checks.arrays import is_masked as is_masked
from argument_checks.arrays import is_moderate as is_moderate
from argument_checks.arrays import is_plain as is_plain
from argument_checks.arrays import not_negative as not_negative
from argument_checks.arrays import read_only as read_only
from argument_checks.arrays import real as real
from argument_checks.arrays import series as series
from argument_checks.arrays import shaped as shaped
from argument_checks.arrays import vector as vector
from argument_checks.intervals import limit_vectors as limit_vectors
from argument_checks.intervals import limits as limits
from argument_checks.kinds import attributes as attributes
from argument_checks.kinds import choice as choice
from argument_checks.kinds import flag as flag
from argument_checks.kinds import function as function
from argument_checks.kinds import members as members
from argument_checks.kinds import methods as methods
from argument_checks.kinds import seed as seed
from argument_checks.matrices import batch as batch
from argument_checks.matrices import matrix as matrix
from argument_checks.matrices import positive_semidefinite as positive_semidefinite
from argument_checks.matrices import sized as sized
from argument_checks.matrices import weight as weight
from argument_checks.records import computed as computed
from argument_checks.records import keep as keep
from argument_checks.records import lock as lock
from argument_checks.records import made as made
from argument_checks.scalars import at_most_one as at_most_one
from argument_checks.scalars import duration as duration
from argument_checks.scalars import fraction as fraction
from argument_checks.scalars import index as index
from argument_checks.scalars import index_set as index_set
from argument_checks.scalars import indices as indices
from argument_checks.scalars import instance as instance
from argument_checks.scalars import number as number
from argument_checks.scalars import positive as positive
from argument_checks.scalars import shown as shown
from argument_checks.scalars import signed as signed
from argument_checks.scalars import within as within

__version__ = "0.2.0"
"""The distribution's version, written here alone: this package is below all others."""
