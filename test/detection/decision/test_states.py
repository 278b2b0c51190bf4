"""The state machine: what leads from each state to which, and that nothing chatters."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions, states
from hunt_ros.detection.decision.rules import rows_of, rules_of
from hunt_ros.detection.output import blank_rows
from hunt_ros.detection.regions import State

CONFIG = DetectorConfig()
RULES = rules_of(CONFIG, 6.4, 8.0)
EDGE, CYCLE, FLOOR = 240e-6, 630e-6, 10e-6


class Machine:
    """The state machine alone, fed with the numbers of rows."""

    def __init__(self, state: State = State.QUIET) -> None:
        self.memory = decisions.fresh_memory()
        self.memory['state']['motion' if state <= State.DISTURBED else 'hunting']['word'] = state
        self.memory['state']['reference'] = CYCLE
        self.memory['floor']['square'] = FLOOR**2
        self.memory['motion']['marks'] = 1000

    def feed(
        self,
        amplitude: float,
        probability: float,
        rows: int = 1,
        hunts: float = 0.5,
        edge: float = EDGE,
        stable: float = CYCLE,
        growth: float = 0.0,
    ) -> State:
        row = blank_rows(np.zeros(1, dtype=np.int64))
        row['noise_floor'], row['escape_probability'] = FLOOR, probability
        row['unstable_amplitude'], row['stable_amplitude'] = edge, stable
        row['growth_rate'], row['growth_rate_std'] = growth, 0.1
        memory = self.memory[0]
        memory['motion']['cycles'] = hunts
        for _ in range(rows):
            states.judge(
                RULES,
                memory['state'],
                memory['motion'],
                amplitude,
                1e-6,
                True,
                row[0],
            )
        return State(states.word_of(memory['state']))


DISTURBED, QUIET, ESCAPE = (
    rows_of(RULES, seconds) for seconds in (states.DISTURBED_S, states.QUIET_S, states.ESCAPE_S)
)
HOLD = ESCAPE + 2


def test_a_disturbance_and_its_end() -> None:
    machine = Machine()
    assert machine.feed(4.0 * FLOOR, 0.0, DISTURBED + 2) is State.DISTURBED
    assert machine.feed(2.5 * FLOOR, 0.0, 500) is State.DISTURBED  # between the thresholds
    assert machine.feed(1.5 * FLOOR, 0.0, QUIET + 2) is State.QUIET


def test_the_larger_the_disturbance_the_sooner_the_first_word() -> None:
    def rows_of_quiet(amplitude: float, probability: float) -> int:
        machine, rows = Machine(), 0
        while machine.feed(amplitude, probability) is State.QUIET:
            rows += 1
        return rows

    small = rows_of_quiet(0.8 * EDGE, 0.1)
    assert small == DISTURBED
    assert rows_of_quiet(2.0 * EDGE, 1.0) == small  # escaping, but not yet for its hold
    assert rows_of_quiet(1.1 * CYCLE, 1.0) == small
    growing = Machine()
    growing.feed(0.8 * EDGE, 0.1, DISTURBED)  # asks for another word on its way
    assert growing.feed(1.3 * EDGE, 0.99) is State.DISTURBED


def test_an_escape_is_over_only_when_it_is_unlikely() -> None:
    machine = Machine()
    machine.feed(EDGE * 1.3, 0.99, HOLD)
    assert machine.feed(EDGE, 0.6, 300) is State.ESCAPING
    assert machine.feed(EDGE * 0.9, 0.4, QUIET + 2) is State.DECAYING
    assert machine.feed(FLOOR, 0.0, QUIET + 2) is State.QUIET


def test_inside_the_noise_nothing_escapes() -> None:
    machine = Machine()
    assert machine.feed(2.9 * FLOOR, 1.0, 500, edge=FLOOR) is State.QUIET


def test_the_limit_cycle_is_reached_kept_and_left() -> None:
    machine = Machine()
    machine.feed(EDGE * 1.5, 1.0, HOLD)
    assert machine.feed(0.9 * CYCLE, 1.0, HOLD) is State.LIMIT_CYCLE
    assert machine.feed(0.75 * CYCLE, 1.0, 500) is State.LIMIT_CYCLE  # slower: a smaller cycle
    assert machine.feed(0.5 * CYCLE, 1.0, hunts=0.01) is State.DECAYING


def test_what_grows_for_sure_is_not_on_the_limit_cycle_before_it_is_as_large() -> None:
    machine = Machine(State.ESCAPING)
    assert machine.feed(0.95 * CYCLE, 1.0, 100, growth=0.8) is State.ESCAPING
    assert machine.feed(1.01 * CYCLE, 1.0, HOLD, growth=0.8) is State.LIMIT_CYCLE


def test_what_grows_slowly_far_below_the_limit_cycle_of_the_form_is_not_in_it() -> None:
    machine = Machine()
    small = 0.16 * CYCLE  # as steady as a cycle, for a while
    assert machine.feed(small, 1.0, HOLD, hunts=0.999, edge=0.1 * EDGE) is State.ESCAPING
    assert machine.feed(small, 1.0, 1000, hunts=0.999, edge=0.1 * EDGE) is State.ESCAPING
    assert machine.feed(0.6 * CYCLE, 1.0, 100, hunts=0.999, growth=0.8) is State.ESCAPING
    # A form may be wrong about the size.
    assert machine.feed(0.6 * CYCLE, 1.0, hunts=0.999) is State.LIMIT_CYCLE


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(0.51, 0.949), min_size=5, max_size=200), st.sampled_from(list(State)))
def test_chances_between_the_thresholds_never_raise_and_never_end_an_alarm(
    chances: list[float], start: State
) -> None:
    machine = Machine(start)
    seen = [machine.feed(EDGE * 1.1, chance) for chance in chances]
    if start is State.ESCAPING:
        assert set(seen) == {State.ESCAPING}
    else:
        assert State.ESCAPING not in seen
    assert np.count_nonzero(np.diff([start, *seen])) <= 1


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.floats(1e-9, 1e-3), st.floats(0.0, 1.0)), max_size=150))
def test_no_state_lasts_for_less_than_the_hold_of_the_next(rows) -> None:
    # Before hunting, quiet and disturbed count as one: the wait goes on from one to the other.
    machine = Machine()
    holds = {
        State.QUIET: QUIET,
        State.DISTURBED: DISTURBED,
        State.ESCAPING: ESCAPE,
        State.LIMIT_CYCLE: ESCAPE,
        State.DECAYING: 0,
    }
    last, lasted = State.QUIET, 10**6
    for amplitude, chance in rows:
        now = machine.feed(amplitude, chance, edge=EDGE)
        if now is not last:
            assert lasted >= holds[now]
            calm_before = now is State.DISTURBED and last is State.QUIET
            last, lasted = now, lasted if calm_before else 0
        lasted += 1
