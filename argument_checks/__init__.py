"""Argument checks of all packages: invalid input raises immediately, with a one-sentence message.

The message names the argument, the expected value and the given one. Every check returns the
argument, converted where necessary (to float64, for example). The usual import is `import
argument_checks as check`.
"""

from argument_checks.arrays import LARGEST as LARGEST
from argument_checks.arrays import SMALLEST as SMALLEST
from argument_checks.arrays import Array as Array
from argument_checks.arrays import Indices as Indices
from argument_checks.arrays import Mask as Mask
from argument_checks.arrays import array as array
from argument_checks.arrays import common_axes as common_axes
from argument_checks.arrays import flat as flat
from argument_checks.arrays import frozen as frozen
from argument_checks.arrays import is_masked as is_masked
from argument_checks.arrays import is_moderate as is_moderate
from argument_checks.arrays import is_plain as is_plain
from argument_checks.arrays import limits as limits
from argument_checks.arrays import read_only as read_only
from argument_checks.arrays import short_repr as short_repr
from argument_checks.arrays import weight as weight
from argument_checks.records import computed as computed
from argument_checks.records import freeze_field as freeze_field
from argument_checks.records import lock as lock
from argument_checks.records import unchecked_record as unchecked_record
from argument_checks.values import DAY_S as DAY_S
from argument_checks.values import SECONDS as SECONDS
from argument_checks.values import attributes as attributes
from argument_checks.values import choice as choice
from argument_checks.values import flag as flag
from argument_checks.values import function as function
from argument_checks.values import indices as indices
from argument_checks.values import instance as instance
from argument_checks.values import integer as integer
from argument_checks.values import members as members
from argument_checks.values import number as number

__version__ = "1.0.0rc1"
"""Version of the distribution, defined here because this package imports no other."""
