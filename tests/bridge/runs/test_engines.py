"""Which engine works: slips are one line, and the local one is there afterwards."""

from __future__ import annotations

import pytest

from bridge.cli import main
from bridge.errors import DsnetError
from bridge.runs.engines import use_engine
from bridge.runs.worker_pool import on_any_node, worker_pool


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--engine", "spark"), "--engine spark; expected local or ray"),
        (("--address", "10.0.0.1:6379"), "--address 10.0.0.1:6379 without a cluster"),
        (("--engine=local", "--address=auto"), "--address auto without a cluster"),
    ],
)
def test_slips_are_told_in_one_line(options, said, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["check", "--profile", "smoke", *options])
    assert caught.value.code == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert said in told[0]


def test_the_local_engine_leaves_work_as_it_is():
    with use_engine("local"):
        assert on_any_node("threads") == "threads"


def _double(factor: int, item: int) -> int:
    if item < 0:
        raise DsnetError(f"item {item}", "0 or more", "Pass another.")
    return factor * item


@pytest.mark.cluster
def test_work_on_ray_comes_back_in_order_and_errors_keep_their_words():
    pytest.importorskip("ray", reason="Ray is not installed: extra ray")
    with use_engine("ray"):
        assert on_any_node("threads") == "ray"
        with worker_pool(on_any_node("serial"), 2) as pool:
            assert list(pool.map(_double, range(20))) == list(range(0, 40, 2))
            # What is no function of a module, too.
            assert list(pool.map(lambda factor, item: factor + item, [1, 2])) == [3, 4]
        with (
            pytest.raises(DsnetError, match=r"^item -1; expected 0 or more"),
            worker_pool("ray", 2) as pool,
        ):
            list(pool.map(_double, [1, -1]))
    assert on_any_node("threads") == "threads"


@pytest.mark.cluster
@pytest.mark.parametrize("address", ["127.0.0.1:1", "127.0.0.1:none"])
def test_no_cluster_at_an_address_is_one_line(address):
    pytest.importorskip("ray", reason="Ray is not installed: extra ray")
    refused = pytest.raises(DsnetError, match=f"{address}, where no Ray cluster answers")
    with refused, use_engine("ray", address):
        pass
