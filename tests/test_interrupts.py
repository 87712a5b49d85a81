import os
import signal

import pytest

from laesi_tf.common.interrupts import defer_interrupt


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def test_the_first_ctrl_c_is_only_noted_and_the_second_interrupts():
    notes = []
    with defer_interrupt(lambda: notes.append("stopping")) as was_pressed:
        assert not was_pressed()
        press_ctrl_c()
        assert was_pressed() and notes == ["stopping"]
        with pytest.raises(KeyboardInterrupt):
            press_ctrl_c()
    with pytest.raises(KeyboardInterrupt):
        press_ctrl_c()


def test_a_program_that_handles_ctrl_c_itself_keeps_its_handler():
    calls = []
    previous = signal.signal(signal.SIGINT, lambda *_: calls.append(None))
    try:
        with defer_interrupt(lambda: None) as was_pressed:
            press_ctrl_c()
            assert calls == [None] and not was_pressed()
    finally:
        signal.signal(signal.SIGINT, previous)
