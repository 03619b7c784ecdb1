"""Each check in Python that meets a misuse is removed once: its case must fail."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import fuseline
import pytest

#: A case, the file of the package, and what is written instead of what.
GUARDS = [
    ("fraction_of_a_nanosecond", "_words.py", 'or not hasattr(nanoseconds, "__index__")', ""),
    ("ns_below_0", "_words.py", "if not 0 <= number < 2**64:", "if False:"),
    ("local_deadline_of_0", "_local.py", "and nanoseconds(deadline) == 0", "and False"),
    (
        "offered_deadline_below_0",
        "_drive.py",
        "self.counting.handler_failed(it.cloud.p)",
        "pass",
    ),
    (
        "offered_int",
        "_drive.py",
        "request, it.deadline_of(deadline)",
        "request, it.deadline_of(deadline / 1e3)",
    ),
    (
        "milliseconds_for_local",
        "_operator.py",
        "deadline is not None and deadline > self._greatest_deadline",
        "False",
    ),
    ("capture_in_seconds", "_item.py", 'not hasattr(number, "__index__")', "False"),
    ("lineage_that_cannot_be", "_item.py", "if not 0 <= number < 2**64:", "if False:"),
    ("no_lineage", "_operator.py", "not isinstance(lineage, Lineage)", "False"),
    ("capture_by_the_wall_clock", "_item.py", "captured > now + CAPTURE_SLACK", "False"),
    ("joined_capture_by_the_wall_clock", "_item.py", "captured > now + CAPTURE_SLACK", "False"),
    ("clock_of_seconds", "_wiring.py", 'not hasattr(now, "__index__")', "False"),
    ("clock_that_breaks", "_operator.py", "now = driver.now()", "now = self._count = 1"),
    ("message_that_changes", "_operator.py", "message = snapshot(message)", "pass"),
    ("joined_message_that_changes", "_join.py", "message = snapshot(message)", "pass"),
    ("feed_of_no_stream", "_wiring.py", "bytearray, memoryview, Mapping)", "bytearray)"),
    ("one_name_twice", "_wiring.py", "if name in others:", "if False:"),
    ("one_policy_twice", "_wiring.py", "if any(a is b", "if False and any(a is b"),
    (
        "one_local_twice",
        "_local.py",
        "if self._pool is not None:\n            raise",
        "if False:\n            raise",
    ),
    ("odd_limit", "_operator.py", 'check_count(limit, 1, "a limit")', "pass"),
    ("substitute_after_the_start", "_setup.py", "if self._driver is not None:", "if False:"),
    ("two_substitutes", "_setup.py", "if self._handlers.substitute is not None:", "if False:"),
    ("state_without_return", "_wiring.py", "    if value is None:", "    if False:"),
    ("generator_for_local", "_wiring.py", "if inspect.isgeneratorfunction(function)", "if False"),
    (
        "generator_for_a_message_handler",
        "_wiring.py",
        "inspect.isgeneratorfunction(function)",
        "False",
    ),
    ("generator_from_local", "_wiring.py", "    if is_generator:", "    if False:"),
    ("generator_from_a_cloud", "_wiring.py", "    if is_generator:", "    if False:"),
    ("async_substitute", "_wiring.py", "if is_awaitable(value):", "if False:"),
    ("decorated_handle", "_wiring.py", "and not is_async(function)", ""),
    (
        "cloud_error_without_text",
        "_errors.py",
        "except Exception as raised:",
        "except OSError as raised:",
    ),
    (
        "local_error_without_text",
        "_errors.py",
        "except Exception as raised:",
        "except OSError as raised:",
    ),
    ("plain_handle", "_wiring.py", "if is_named and not is_async(handle)", "if False"),
    ("generator_for_a_handle", "_wiring.py", "inspect.isasyncgenfunction(handle)", "False"),
    (
        "lambda_that_returns_a_value",
        "_wiring.py",
        "if not is_awaitable(returned):",
        "if False:",
    ),
    ("handle_that_does_not_await", "_wiring.py", "if is_awaitable(value):", "if False:"),
    (
        "response_handler_that_does_not_await",
        "_wiring.py",
        "if is_awaitable(value):",
        "if False:",
    ),
    ("lambda_for_an_async_local", "_wiring.py", "if is_awaitable(value):", "if False:"),
    ("lambda_that_encodes_async", "_wiring.py", "if is_awaitable(value):", "if False:"),
    ("class_for_a_handle", "_wiring.py", "if inspect.isclass(function):", "if False:"),
    ("handle_that_cannot_be_called", "_wiring.py", "if not callable(function):", "if False:"),
    ("async_message_handler", "_wiring.py", "if is_async(function):", "if False:"),
    ("response_handler_that_cannot_be_called", "_wiring.py", "not callable(handler)", "False"),
    ("class_for_a_policy", "_wiring.py", "if inspect.isclass(policy):", "if False:"),
    ("half_a_policy", "_wiring.py", "if any(has) and not all(has):", "if False:"),
    ("class_for_local", "_wiring.py", "if inspect.isclass(function):", "if False:"),
    ("plain_local_for_tasks", "_local.py", "if not is_async(compute):", "if False:"),
    ("one_priority_twice", "_wiring.py", "if priority in others:", "if False:"),
    ("odd_priority", "_wiring.py", "isinstance(priority, bool) or not isinstance(", "not ("),
    ("priority_of_local", "_wiring.py", "if not 1 <= priority <= 65535:", "if False:"),
    ("no_calls", "_wiring.py", "or count < least", ""),
    ("no_pair", "_drive.py", "self.counting.handler_failed(it.cloud.p)", "pass"),
    ("situation_that_raises", "_operator.py", "driver.counting.handler_failed(None)", "pass"),
    ("guard_under_progressive", "_operator.py", "assumes_one_output(it.policy)", "False"),
    ("write_elsewhere", "_operator.py", "threading.get_ident() == self._thread", "True"),
    ("stop_elsewhere", "_operator.py", "threading.get_ident() == self._thread", "True"),
    ("too_many_on_their_way", "_operator.py", "self._on_their_way >= self._window", "False"),
    ("ignored_future", "_operator.py", "times = self._not_taken", "times = 3"),
    (
        "write_before_the_start",
        "_operator.py",
        'raise ConfigError("the operator has not started',
        'print("the operator has not started',
    ),
    (
        "write_after_close",
        "_operator.py",
        "        if self._is_last:\n            raise",
        "        if False:\n            raise",
    ),
    (
        "started_twice",
        "_operator.py",
        'raise ConfigError("an operator is started once',
        'print("an operator is started once',
    ),
    (
        "cloud_after_the_start",
        "_setup.py",
        "if self._driver is not None:",
        "if False:",
    ),
    ("write_in_a_handler", "_operator.py", "if self._is_handling:", "if False:"),
    (
        "wait_for_oneself",
        "_blocking.py",
        'raise RuntimeError("a handler must not wait for its own operator")',
        "return None",
    ),
    ("front_after_its_end", "_blocking.py", "or self._loop.is_closed()", ""),
    (
        "handle_that_blocks",
        "_drive.py",
        "self._lag_warning,\n            self.counting",
        "2**62,\n            self.counting",
    ),
    (
        "message_handler_that_blocks",
        "_drive.py",
        "self.counting.ran(it.cloud.p, took)",
        "pass",
    ),
    (
        "local_that_hangs",
        "_local.py",
        "deadline: Duration | None = 1.0",
        "deadline: Duration | None = None",
    ),
    (
        "items_that_nobody_reads",
        "_operator.py",
        "if len(self._items) >= self._output_len:",
        "if False:",
    ),
    ("two_feeds", "_operator.py", "if not self._feeds and not self._is_last:", "if True:"),
    (
        "feed_after_a_feed",
        "_operator.py",
        'raise Closed("the operator takes no more messages; feed',
        'print("',
    ),
    ("block_that_ends_before_a_list", "_operator.py", "await asyncio.wait(finite)", "pass"),
    ("block_that_nobody_reads", "_operator.py", "await self._end_feeds()", "pass"),
    ("block_left_in_the_midst", "_operator.py", "self._not_taken += left", "pass"),
    ("feed_that_nobody_reads", "_operator.py", "self._read_count == self._read_before", "False"),
    (
        "stream_that_is_cancelled",
        "_operator.py",
        "except BaseException as error:",
        "except Exception as error:",
    ),
    (
        "cancelled_in_a_handler",
        "_drive.py",
        "except (Exception, asyncio.CancelledError):",
        "except Exception:",
    ),
    (
        "joined_items_that_are_cancelled",
        "_join.py",
        "if self._is_ending:",
        "if False:\n                pass\n            joined.is_open = False\n            if True:",
    ),
    (
        "read_that_gives_up",
        "_items.py",
        "_next(self.source))\n        await asyncio.wait({self._reading})",
        "_next(self.source))\n        await self._reading",
    ),
    ("items_that_fail_for_two_readers", "_items.py", "if self._error is not None:", "if False:"),
    ("timeout_with_a_unit", "_wiring.py", "return timeout.total_seconds()", "return timeout"),
    ("timeout_that_is_none", "_wiring.py", "if isinstance(timeout, bool) or", "if"),
    (
        "exit_in_a_call",
        "_blocking.py",
        '_log.error("%s: %s in a call',
        '_log.debug("%s: %s in a call',
    ),
    (
        "fork_of_a_blocking_operator",
        "_blocking.py",
        "if os.getpid() != self._process:",
        "if False:",
    ),
    ("join_written_elsewhere", "_join.py", "threading.get_ident() == self._thread or", "True or"),
    ("join_whose_loop_is_held_up", "_join.py", "if done.cancel():", "if True:"),
    (
        "reply_that_is_no_action",
        "_actions.py",
        "    form = form_of(action, where)\n",
        "    return\n",
    ),
    ("reply_that_is_no_chunk", "_chunks.py", "if not actions:", "if False:"),
    ("form_of_a_policy_on_board", "robot.py", "self._is_guessed, self._like = False, form", "pass"),
    ("blend_that_makes_no_action", "_chunks.py", "self._check(action)", "pass"),
    (
        "odd_max_jump",
        "_chunks.py",
        "if max_jump is not None:\n        is_number",
        "if False:\n        is_number",
    ),
    (
        "slow_policy_on_board",
        "robot.py",
        "operator.use_substitute(lambda _: snapshot(self._last))",
        "pass",
    ),
    ("policy_that_can_be_called", "robot.py", 'getattr(on_board, "infer", on_board)', "on_board"),
    (
        "odd_period",
        "robot.py",
        "if tick is not None and not 0 < tick <= LONGEST_PERIOD:",
        "if False:",
    ),
    ("policy_for_a_function", "robot.py", "if not callable(remote) or", "if"),
    ("hold_of_no_action", "robot.py", 'form_of(self.first, "what is held")', "pass"),
    (
        "callback_of_failures_that_raises",
        "robot.py",
        'except Exception:\n                _log.exception("%s: what is',
        'except OSError:\n                _log.exception("%s: what is',
    ),
    ("one_trace_twice", "_tracefile.py", "fcntl.LOCK_EX | fcntl.LOCK_NB", "fcntl.LOCK_SH"),
    ("trace_of_another_program", "_tracefile.py", "fcntl.LOCK_EX | fcntl.LOCK_NB", "fcntl.LOCK_SH"),
    ("trace_that_is_removed", "_drive.py", "self._trace.lost()", "None"),
    ("program_that_ends_without_close", "_drive.py", "atexit.register(_end_recordings)", "pass"),
    (
        "script_without_its_guard",
        "_processes.py",
        "except EOFError:\n            self._process.join(GRACE)",
        "except EOFError:\n            return",
    ),
    (
        "lambda_for_a_process",
        "_processes.py",
        "except Exception as error:\n            ours.close()",
        "except OSError as error:\n            ours.close()",
    ),
    (
        "process_that_cannot_answer",
        "_processes.py",
        "ForkingPickler.loads(ForkingPickler.dumps(error))",
        "pass",
    ),
    ("encode_that_hangs", "_drive.py", "self._encoder_hangs(source, request)", "pass"),
    (
        "encode_that_always_hangs",
        "_drive.py",
        "source.encoders.hung_len() >= HUNG_ENCODERS",
        "False",
    ),
    ("encode_without_return", "_drive.py", 'check_read(encoded, "what encodes")', "pass"),
    ("exception_for_a_result", "_wiring.py", "if isinstance(value, BaseException):", "if False:"),
    ("concurrent_future_for_a_result", "_wiring.py", "if isinstance(value, Future):", "if False:"),
    ("coroutine_for_a_message", "_wiring.py", "if type(message) is CoroutineType:", "if False:"),
    ("result_that_changes", "_drive.py", "copies = self._handlers.copy_messages", "copies = False"),
    ("join_without_lineage", "_join.py", "if dropped.why is JoinDropReason.NO_KEY", "if False"),
    ("items_of_a_list", "_items.py", "if not isinstance(source, AsyncIterable):", "if False:"),
    ("async_side_response", "_side.py", "if is_awaitable(handled):", "if False:"),
    ("odd_commit", "_wiring.py", "if commit not in words:", "if False:"),
    ("second_loop", "_operator.py", "self._check_loop(", "print("),
    ("hold_of_a_policy", "robot.py", "if callable(self.first):", "if False:"),
    ("odd_chunk", "_chunks.py", "if chunk.max_age < chunk.every:", "if False:"),
    ("class_for_a_policy_on_board", "robot.py", "if inspect.isclass(on_board):", "if False:"),
    ("server_without_return", "grpc.py", 'check_read(value, "infer of the server")', "pass"),
    ("server_of_a_plain_function", "grpc.py", "check_handle(infer)", "pass"),
    ("feed_that_is_too_fast", "_operator.py", "and driver.has_room(self._window)", ""),
    ("feed_that_fails", "_operator.py", "self._feed_error = self._feed_error or error", "pass"),
]


@pytest.mark.parametrize(("case", "file", "guard", "instead"), GUARDS, ids=[it[0] for it in GUARDS])
def test_the_case_fails_without_its_guard(
    tmp_path: Path, case: str, file: str, guard: str, instead: str
) -> None:
    package = tmp_path / "fuseline"
    shutil.copytree(Path(fuseline.__file__).parent, package)
    text = (package / file).read_text()
    assert guard in text, f"{file} has no {guard}"
    (package / file).write_text(text.replace(guard, instead))
    tests = Path(__file__).parent
    options = [
        "-q",
        "-x",
        "--tb=native",
        "-o",
        "addopts=",
        "-p",
        "no:cacheprovider",
        "-k",
        f"test_{case}",
    ]
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *tests.glob("test_misuse*.py")],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{tests}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ended.returncode == 1, ended.stdout
    assert "failed" in ended.stdout
