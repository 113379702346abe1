from tools.evaluation.team import Team, needed_memory
from tools.host.console import Console


def test_processes_share_the_memory() -> None:
    one = needed_memory(10**6)
    assert one == 250 * 2**20 + 400 * 10**6
    assert [Team(Console(), 4, memory).processes(10**6) for memory in (one - 1, one, 3 * one, 100 * one)] == [1, 1, 3, 4]
