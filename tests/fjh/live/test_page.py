"""Clock of the page, and clicks between two ticks."""

import numpy as np
import pytest

from fjh.live.page import LocalServer, Page
from fjh.study.errors import WrongInput
from sim import ModelError, SimulationDiverged


def test_clicks_take_effect_within_five_ticks(page: Page, monkeypatch):
    """Clicks come during the simulation, at the first tick of each batch."""
    advance, start_ticks, done = page.session.advance, list[int](), list[int]()

    def clicked(ticks: int) -> int:
        start_ticks.append(page.session.tick)
        page._clicks.put(lambda: done.append(page.session.tick))
        return advance(ticks)

    monkeypatch.setattr(page.session, "advance", clicked)
    page.advance(0.043, until=np.inf)
    assert len(done) == len(start_ticks) >= 8
    assert all(0 < then - at <= 5 for at, then in zip(start_ticks, done, strict=True))


def test_delay_of_the_clock_is_not_caught_up(page):
    """Simulation ends at the time of a frame; a delay is not caught up in the next one."""
    assert page.advance(1.0, until=-np.inf) == 0.0
    start = page.session.tick
    assert page.advance(0.003, until=np.inf) == pytest.approx(0.003)
    assert page.session.tick == start + 3


@pytest.mark.parametrize("error", [ModelError("no lock"), WrongInput("no"), OSError("disk full")])
def test_failed_click_is_reported_and_simulation_continues(page, error):
    def refuse() -> None:
        raise error

    page._clicks.put(refuse)
    assert page.advance(0.005, until=np.inf) == pytest.approx(0.005)
    assert page._panel.message == str(error)


def test_diverged_machines_are_replaced_with_a_message(page, monkeypatch):
    def diverge(ticks: int) -> int:
        monkeypatch.undo()
        raise SimulationDiverged(0.1, np.zeros(3))

    page.session.make(0, "free")
    monkeypatch.setattr(page.session, "advance", diverge)
    page.advance(0.005, until=np.inf)
    assert page.session.states == ["healthy"] * 6 and page.session.tick == 5
    assert "the page shows new machines" in page._panel.message


def test_neither_a_tunnel_nor_a_port_of_another_program_is_opened(page):
    """The method that viser calls when a client clicks on sharing opens no tunnel."""
    assert page._server.request_share_url() is None
    with pytest.raises(WrongInput, match="used by another program"):
        LocalServer(page._server.get_port())
