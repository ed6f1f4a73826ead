"""Rerun recordings: made after a run, opened without a click.

The `.rrd` is a view; the `.npz` beside it is the record.
"""
