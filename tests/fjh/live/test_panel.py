"""What the page says that a pilot believes, and what a pilot is told by its elements."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from fjh.live.flight import Flight
from fjh.live.page import LocalServer, Page
from fjh.rig import Rig
from fjh.rig.events import Event
from fjh.study.errors import WrongInput
from ftc.fdi import Fault
from sim import ModelError, SimulationDiverged
from tests.fjh.live.browser import free_port
from tests.ftc.hexapod import diagnosis

LEARNING = "It takes the first 0.8 s for the sound machine."


@cache
def rig() -> Rig:
    return Rig.hexapod()


def says(state: Any) -> str:
    flight = Flight(rig(), rig().controller(), 1, 0)
    flight.state = state
    return flight.belief


@pytest.fixture(scope="module")
def learned() -> Any:
    """A supervisor's state when it knows the sound machine."""
    return rig().fly(rig().supervisor(), rig().path("circle", duration_s=0.9)).state


def test_a_pilot_that_learns_says_so_and_then_that_all_is_sound(learned):
    assert says(rig().supervisor().start()) == LEARNING
    assert says(learned) == "All actuators are believed sound."


def test_a_pilot_that_learns_what_no_failure_explains_does_not_speak_of_its_first_second(learned):
    """Its spectrum is new then, as at the start."""
    new = rig().supervisor().start().watch
    again = replace(learned, watch=replace(new, relearns=1))
    assert again.is_learning
    assert says(again) == (
        "All actuators are believed sound; what no failure explains is learned as part of the "
        "machine."
    )


def test_a_failure_that_is_believed_is_named_with_its_kind(learned):
    found = diagnosis(Fault(1, "locked"))
    named = replace(learned, watch=replace(learned.watch, diagnosis=found))
    assert says(named) == "strut2 is locked, not yet confirmed; the other actuators do the task."
    sure = replace(learned, confirmed=(replace(found, confirmed=True),))
    assert says(sure) == "strut2 is locked; the other actuators do the task."


def test_a_controller_says_that_it_does_not_diagnose():
    assert says(rig().controller().start()) == ("Does not diagnose: it goes on with what it knows.")


@pytest.mark.long
def test_a_sensor_that_stands_still_is_said_beside_what_is_believed_of_actuators():
    path = rig().path("circle", duration_s=1.1)
    run = rig().fly(rig().supervisor(), path, events=[Event("all_stuck", 1.0)])
    assert says(run.state).startswith("All actuators are believed sound; the sensor of the task ")


# The clock.


@pytest.fixture
def server():
    one = LocalServer(free_port())
    yield one
    one.stop()


@pytest.fixture
def page(server, tmp_path) -> Page:
    return Page(server, rig(), tmp_path, seed=0)


@pytest.mark.long
def test_a_click_is_done_within_five_ticks_of_simulated_time(page):
    """Clicked while the machines move: at the first tick of each batch."""
    advance, asked, done = page.session.advance, list[int](), list[int]()

    def clicked(ticks: int) -> int:
        asked.append(page.session.tick)
        page._clicks.put(lambda: done.append(page.session.tick))
        return advance(ticks)

    page.session.advance = clicked
    page.advance(0.043, until=np.inf)
    assert len(done) == len(asked) >= 8
    assert all(0 < then - at <= 5 for at, then in zip(asked, done, strict=True))


def test_a_clock_that_is_late_lets_go(page):
    """Nothing is done after the time of a frame; a second that is short is not made up for."""
    assert page.advance(1.0, until=-np.inf) == 0.0
    begin = page.session.tick
    assert page.advance(0.003, until=np.inf) == pytest.approx(0.003)
    assert page.session.tick == begin + 3


@pytest.mark.parametrize("error", [ModelError("no lock"), WrongInput("no"), OSError("disk full")])
def test_a_click_that_is_refused_is_said_and_the_machines_go_on(page, error):
    def refuse() -> None:
        raise error

    page._clicks.put(refuse)
    assert page.advance(0.005, until=np.inf) == pytest.approx(0.005)
    assert page._panel.said == str(error)


def test_machines_that_diverge_are_replaced_and_the_page_says_why(page):
    advance = page.session.advance

    def diverge(ticks: int) -> int:
        page.session.advance = advance
        raise SimulationDiverged(0.1, np.zeros(3))

    page.session.make(0, "free")
    page.session.advance = diverge
    page.advance(0.005, until=np.inf)
    assert page.session.states == ["sound"] * 6 and page.session.tick == 5
    assert page._panel.said.endswith("these are new machines, sound and at rest.")


def test_a_weight_that_is_slid_is_that_of_its_actuator(page):
    sliders = [h for h in elements(page) if getattr(h, "label", "").startswith("W1 ")]
    assert [each.label for each in sliders] == [f"W1 {name}" for name in rig().actuators]
    sliders[2].value = 7.5
    page.advance(0.001, until=np.inf)
    assert page.session.goal.joint_weight == (1.0, 1.0, 7.5, 1.0, 1.0, 1.0)


def elements(page: Page) -> list[Any]:
    """Of its panel."""
    return list(page._server.gui._gui_input_handle_from_uuid.values())


def test_a_client_cannot_open_a_tunnel_to_the_internet(server):
    """When a client clicks on sharing, viser asks this method, which opens none."""
    assert server.request_share_url() is None and server._share_tunnel is None


def test_a_port_that_is_taken_is_refused_if_it_was_asked_for(server):
    with pytest.raises(WrongInput, match="another program listens there; leave --port out"):
        LocalServer(server.get_port())


def test_new_machines_that_are_asked_for_just_before_a_frame_are_drawn_in_it(page):
    page.advance(0.01, until=np.inf)
    page._clicks.put(page._panel._restart)
    page.advance(0.0, until=np.inf)
    page.show()
    assert page.session.tick == 1 and page._panel.said == "Sound machines, at rest."
