from tools.host.countdown import Countdown, duration


def test_time_left_is_said_for_people() -> None:
    assert [duration(seconds) for seconds in (0.2, 40, 700, 12000)] == ["1 s", "40 s", "12 min", "3 h 20 min"]
    countdown = Countdown(10, 3)
    assert str(countdown) == "0 of 3 done"
    countdown.finished(4)
    assert str(countdown).startswith("1 of 3 done, about ")
    countdown.finished(4)
    countdown.finished(2)
    assert str(countdown) == "3 of 3 done"
    assert countdown.fraction == 1
