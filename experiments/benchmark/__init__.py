"""The benchmark: times of the closed loop and the mapping, compared with other libraries."""
