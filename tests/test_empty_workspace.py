"""A workspace that no feet fit on any terrain is said, and of which contestant."""

from jaxleg.cli.search import empty_workspaces


def seen(nominal, widened, **bounds):
    """What a result tells of one contestant on one kind."""
    found = {"nominal": nominal, "widened": widened, "nearest": 1.0, "none": 0.0}
    return {"bounds": {"behind": None, "ahead": None, "low": None, "high": 0.5} | bounds, "found": found}


def test_it_is_said_where_bounds_bind_and_nothing_fits():
    """Not where something fits, where nothing bounds, or where no lane was walked."""
    kinds = {"flat": seen(0.0, 0.0, ahead=0.1), "rough": seen(0.0, 0.2, ahead=0.1), "stairs": seen(None, None, low=0.4)}
    empty = empty_workspaces({"workspace": {"best": kinds, "implied": {"flat": seen(0.0, 0.0)}}})
    assert empty == {
        ("best", "flat"): "flat: on no held-out terrain do four feet of best fit its workspace together (ahead 0.1 m)"
    }
