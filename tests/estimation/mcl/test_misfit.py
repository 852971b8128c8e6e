"""A bad fit is said after ten measurements, and when the last twenty are good no more."""

from robotctl.estimation.mcl.misfit import Misfit


def test_a_few_bad_measurements_say_nothing_and_many_do():
    misfit = Misfit()
    found = []
    for _ in range(15):
        misfit.add(-20.0)
        found.append(misfit.is_bad)
    assert found == [False] * 9 + [True] * 6
    misfit.reset()
    assert not misfit.is_bad


def test_what_the_right_map_gives_in_a_crowd_is_not_bad():
    misfit = Misfit()
    for fit in [-2.0] * 20 + [-10.5] * 200:
        misfit.add(fit)
        assert not misfit.is_bad


def test_a_map_that_fits_again_is_right_again():
    misfit = Misfit()
    for _ in range(50):
        misfit.add(-20.0)
    for _ in range(40):
        misfit.add(-1.0)
    assert not misfit.is_bad
