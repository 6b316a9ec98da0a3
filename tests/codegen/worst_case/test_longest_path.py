"""Bounds of small programs whose cycles can be counted by hand, and what has no bound."""

import pytest

from canroll.codegen.worst_case.cycles import Timing
from canroll.codegen.worst_case.longest_path import LongestPath
from canroll.codegen.worst_case.machine_state import MachineState, Promises
from canroll.codegen.worst_case.transfer import Transfer
from canroll.errors import CanrollError

HEAD = ".global main\n.type main, %function\nmain:\n"
TOP = 0x2000_1000


def bound(image, timing=None):
    transfer = Transfer(image, Promises(()), (0x2000_0000, TOP))
    return LongestPath(image, transfer, timing or Timing("cortex-m4")).bound(
        "main", MachineState.start(TOP)
    )


def test_a_straight_line_is_the_sum_of_its_instructions(assembled):
    found = bound(assembled(HEAD + "movs r0, #1\nldr r1, [r0]\nmuls r0, r1, r0\nbx lr\n"))
    # 1 + 2 + 1, and 1 and 3 to refill the pipeline
    assert found.cycles == 8
    assert found.stack == 0


def test_a_loop_takes_the_rounds_that_its_counter_allows(assembled):
    code = HEAD + "movs r0, #10\n1: subs r0, #1\nbne 1b\nbx lr\n"
    # 1, ten rounds of 1 + 1 of which nine branch back for 3 more, 4
    assert bound(assembled(code)).cycles == 1 + 20 + 27 + 4


def test_rounds_of_an_inner_loop_follow_the_outer_one(assembled):
    code = HEAD + (
        "movs r0, #0\n"
        "1: adds r0, #1\nmovs r1, r0\n"
        "2: subs r1, #1\nbne 2b\n"
        "cmp r0, #5\nbne 1b\n"
        "bx lr\n"
    )
    inner = 1 + 2 + 3 + 4 + 5
    cycles = 1 + 5 * 2 + 2 * inner + 3 * (inner - 5) + 5 * 2 + 3 * 4 + 4
    assert bound(assembled(code)).cycles == cycles


def test_the_longer_branch_counts_unless_it_cannot_be_taken(assembled):
    fork = "cmp r0, #7\nbgt 1f\nmovs r1, #0\nmovs r1, #0\nmovs r1, #0\n1: bx lr\n"
    either = bound(assembled(HEAD + fork)).cycles
    never = bound(assembled(HEAD + "movs r0, #8\n" + fork)).cycles
    assert either == 2 + 3 + 4
    assert never == 1 + 2 + 3 + 4


def test_a_saturated_argument_bounds_a_loop(assembled):
    code = HEAD + (
        "cmp r0, #1\nit lt\nmovlt r0, #1\ncmp r0, #16\nit ge\nmovge r0, #16\n"
        "1: subs r0, #1\nbne 1b\nbx lr\n"
    )
    assert bound(assembled(code)).cycles == 6 + 16 * 2 + 15 * 3 + 4


def test_stack_and_cycles_of_calls_add_up(assembled):
    code = HEAD + (
        "push {r4, lr}\nbl inner\npop {r4, pc}\n"
        ".type inner, %function\ninner: push {r0, r1, r4, lr}\nsub sp, #8\nadd sp, #8\n"
        "pop {r0, r1, r4, pc}\n"
    )
    found = bound(assembled(code))
    assert found.stack == 8 + 16 + 8
    assert found.cycles == 3 + 4 + (5 + 1 + 1 + 8) + 6
    assert found.shares == {"inner": 15, "main": 13}


def test_a_case_of_a_switch_that_cannot_be_chosen_does_not_count(assembled):
    switch = "tbb [pc, r0]\n2: .byte (3f-2b)/2, (4f-2b)/2\n.p2align 1\n"
    code = switch + "3: movs r1, #0\nmovs r1, #0\nmovs r1, #0\n4: bx lr\n"
    any_case = bound(assembled(HEAD + "uxtb r0, r0\ncmp r0, #1\nbhi 4f\n" + code)).cycles
    second = bound(assembled(HEAD + "movs r0, #1\n" + code)).cycles
    assert any_case == 3 + 5 + 3 + 4
    assert second == 1 + 5 + 4


def test_wait_states_count_for_every_word_fetched(assembled):
    code = HEAD + "movs r0, #1\nmovs r0, #1\nmovs r0, #1\nbx lr\n"
    plain = bound(assembled(code), Timing("cortex-m4"))
    slow = bound(assembled(code), Timing("cortex-m4", wait_states=2))
    # two words of code, and two in flight behind the branch
    assert slow.cycles == plain.cycles + 2 * 2 + 2 * 2


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("1: b 1b\n", "no bound for the loop"),
        ("1: ldr r0, [r1]\ncmp r0, #0\nbne 1b\nbx lr\n", "no bound for the loop"),
        ("push {lr}\nbl main\npop {pc}\n", "calls too deep: recursion?"),
        ("push {lr}\nblx r3\npop {pc}\n", "call through a pointer"),
        ("cmp r0, #0\nbeq 2f\n1: subs r1, #1\n2: subs r2, #1\nbne 1b\nbx lr\n", "more than one"),
    ],
)
def test_what_has_no_bound_is_refused(assembled, code, message):
    with pytest.raises(CanrollError, match=message):
        bound(assembled(HEAD + code))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cpu": "cortex-m7"}, "unknown processor"),
        ({"cpu": "cortex-m4", "wait_states": -1}, "--wait-states must be 0 to 15"),
        ({"cpu": "cortex-m0", "multiplier": 2}, "--multiplier must be 1 or 32"),
        ({"cpu": "cortex-m4", "division": 1}, "--division must be 2 to 12"),
    ],
)
def test_a_processor_that_cannot_be_is_refused(options, message):
    with pytest.raises(CanrollError, match=message):
        Timing(**options)
