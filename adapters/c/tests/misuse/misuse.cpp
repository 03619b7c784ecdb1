// The C++ wrapper, misused. The library holds 3 clouds with a window of 16, and 5 with 40.
#include <pthread.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../clock.hpp"
#include "cases.h"
#include "fuseline.hpp"
#include "fuseline_capacity.hpp"
#include "fuseline_clock.hpp"
#include "fuseline_join.hpp"
#include "fuseline_stamps.hpp"

namespace {

using namespace std::chrono_literals;
using fuseline::Answer;
using fuseline::Commit;
using fuseline::Instant;
using fuseline::Priority;
using fuseline::Timestamp;

constexpr Priority cloud{1};
const auto ignored = [](const fuseline::Firing&) {};

using ManualClock = SetClock<std::chrono::nanoseconds>;

struct Planner : fuseline::Sink<std::string> {
  unsigned forwarded = 0, missed = 0;
  void forward(Timestamp, Priority, const std::string& value) { forwarded += value.empty() ? 0U : 1U; }
  void miss(Timestamp) { ++missed; }
};
template <class Capacity = fuseline::C3W16>
using Operator = fuseline::Operator<std::string, Planner, Capacity, ManualClock>;

bool is_refused(const std::optional<Answer>& answer, fuseline::Reason why) {
  return answer && answer->is(FUSELINE_OUTCOME_REFUSED) && answer->why() == why;
}
bool is_accepted(const std::optional<Answer>& answer) { return answer && answer->is(FUSELINE_OUTCOME_ACCEPTED); }

// Returns whether a function ends the program by std::terminate, tried in a process of its own.
template <class Function>
bool ends_the_program(Function function) {
  const pid_t child = fork();
  if (child == 0) {
    std::set_terminate([] { _exit(42); });
    function();
    _exit(0);
  }
  int status = 0;
  HOLDS(child > 0 && waitpid(child, &status, 0) == child);
  return WIFEXITED(status) && WEXITSTATUS(status) == 42;
}

// --- units and signs ---

// Each of these as a deadline, of a request and of local, is refused, and local's result is not held back.
template <class Rep, class Period>
void refused_as_deadline(std::chrono::duration<Rep, Period> deadline) {
  Planner planner;
  Operator<> op(planner, 16, Commit::eager, 1s, {{cloud, 31}});
  for (std::uint64_t i = 0; i < 10; ++i) {
    HOLDS(is_refused(op.open(Timestamp{i}, deadline), FUSELINE_REASON_DEADLINE));
    HOLDS(is_accepted(op.open(Timestamp{i})));
    HOLDS(is_refused(op.offer(Timestamp{i}, cloud, deadline, 0), FUSELINE_REASON_DEADLINE));
    HOLDS(op.result(Timestamp{i}, fuseline::local, "boxes").has_value());
  }
  HOLDS(planner.forwarded == 10 && op.held() == 0);
}

CASE(cpp_negative_deadline, "gives a negative deadline: the budget is used up", "refused `deadline`; local's result is forwarded") {
  const auto budget = 30ms, age = 50ms;
  refused_as_deadline(budget - age);
  HOLDS(fuseline::nanoseconds_of(budget - age) == 0);
  refused_as_deadline(1ms - 2ms);
  refused_as_deadline(std::chrono::nanoseconds::min());
  refused_as_deadline(-0.5s);
}
CASE(cpp_deadline_of_0, "gives a deadline of 0", "refused `deadline`") {
  refused_as_deadline(0ms);
  refused_as_deadline(std::chrono::duration<unsigned>(0));
}
CASE(cpp_deadline_not_a_number, "gives a deadline of NaN", "refused `deadline`") {
  const std::chrono::duration<double> none(std::numeric_limits<double>::quiet_NaN());
  refused_as_deadline(none);
  HOLDS(fuseline::nanoseconds_of(none) == 0);
}
CASE(cpp_deadline_too_long, "gives a deadline beyond 64 bits of nanoseconds", "saturates; refused `deadline`: above the greatest") {
  refused_as_deadline(std::chrono::seconds(18446744074));  // wrapped, 0.29 s
  refused_as_deadline(std::chrono::hours(std::chrono::hours::max()));
  refused_as_deadline(std::chrono::duration<double>(std::numeric_limits<double>::infinity()));
  refused_as_deadline(std::chrono::duration<std::uint64_t, std::nano>::max());
}
CASE(cpp_wrong_unit, "gives seconds instead of milliseconds", "refused `deadline`: above the greatest") { refused_as_deadline(400s); }
CASE(cpp_exact_units, "gives a deadline in odd units", "converted exactly, rounded down") {
  HOLDS(fuseline::nanoseconds_of(std::chrono::duration<int, std::ratio<1, 30>>(1)) == 33333333);
  HOLDS(fuseline::nanoseconds_of(std::chrono::duration<std::int64_t, std::pico>(1999)) == 1);
  HOLDS(fuseline::nanoseconds_of(std::chrono::duration<std::uint64_t, std::nano>::max()) == UINT64_MAX);
  HOLDS(fuseline::nanoseconds_of(18446744073s) == 18446744073000000000U);
  HOLDS(fuseline::nanoseconds_of(std::chrono::duration<double>(0.25)) == 250000000);
}
CASE(cpp_no_greatest_deadline, "sets a greatest deadline of 0 or less", "status `deadline`, no machine") {
  for (const auto greatest : {0ms, -1ms}) {
    const fuseline::Machine<> machine(16, Commit::eager, greatest, {});
    HOLDS(!machine && machine.status() == FUSELINE_STATUS_DEADLINE);
  }
}
CASE(cpp_overdue_difference, "computes the time until a past due instant", "negative: it does not wrap to a sleep of centuries") {
  const Instant due = Instant::from_monotonic(20ms), now = Instant::from_monotonic(50ms);
  HOLDS(due - now == -30ms && now - due == 30ms);
  HOLDS(Instant::from_monotonic(std::chrono::duration<std::uint64_t, std::nano>::max()) - Instant() == std::chrono::nanoseconds::max());
}
CASE(cpp_instant_before_start, "gives a reading before the clock's start", "counts as the start") {
  HOLDS(Instant::from_monotonic(-5ms) == Instant());
  HOLDS(Instant(ManualClock::time_point(-5ms)) == Instant());
  Planner planner;
  ManualClock::at = 5ms;
  Operator<> op(planner, 16, Commit::eager, 1s, {});
  ManualClock::at = 2ms;
  const auto opened = op.open(Timestamp{1});
  ManualClock::at = {};
  HOLDS(is_accepted(opened) && opened->at() == Instant());
}
CASE(cpp_clock_that_ends, "gives a deadline beyond the clock's last reading", "the next due instant is that last reading") {
  Planner planner;
  ManualClock::at = std::chrono::nanoseconds::max() - 5ns;
  Operator<> late(planner, 16, Commit::eager, 1s, {});
  HOLDS(is_accepted(late.open(Timestamp{1}, 10ns)));
  HOLDS(late.next_due() == ManualClock::time_point::max());
  ManualClock::at = std::chrono::nanoseconds::min();
  Operator<> early(planner, 16, Commit::eager, 1s, {});
  HOLDS(is_accepted(early.open(Timestamp{1}, 10ns)));
  HOLDS(early.next_due() == ManualClock::time_point(std::chrono::nanoseconds::min() + 10ns));
  ManualClock::at = {};
}

// --- shapes and lifetimes ---

CASE(cpp_other_shape, "uses an `Own<C, W>` that the library lacks", "status `capacity`, no machine") {
  using fuseline::Machine;
  using fuseline::Own;
  HOLDS((Machine<Own<15, 40>>(40, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_CAPACITY));
  HOLDS((Machine<Own<5, 60>>(40, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_CAPACITY));
  HOLDS((Machine<Own<5, 39>>(39, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_CAPACITY));
}
CASE(cpp_no_capacity_has_room, "gives more clouds or a greater window at run time than any capacity of the library has", "status `capacity`, no machine; what fits one of them has the smallest") {
  using Any = fuseline::Machine<fuseline::AnyCapacity>;
  std::array<fuseline::Cloud, 15> many;
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = {Priority{i + 1}, 31};
  HOLDS(Any(41, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_CAPACITY);
  HOLDS(Any(static_cast<std::uint32_t>(-1), Commit::eager, 1s, {}).status() == FUSELINE_STATUS_CAPACITY);
  HOLDS(Any(4, Commit::eager, 1s, many.data(), 6).status() == FUSELINE_STATUS_CAPACITY);
  HOLDS(Any(0, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_WINDOW);
  HOLDS(Any(40, Commit::eager, 1s, many.data(), 5) && Any(16, Commit::eager, 1s, many.data(), 4) && Any(16, Commit::eager, 1s, many.data(), 3));
  HOLDS(fuseline::AnyCapacity::Storage(3, 16).capacity() == fuseline::C3W16::id && fuseline::AnyCapacity::Storage(3, 17).capacity() == fuseline_own_capacity());
  Planner planner;
  Operator<fuseline::AnyCapacity> op(planner, 2, Commit::eager, 1s, many.data(), 1);
  for (const std::uint64_t t : {1U, 2U}) {
    HOLDS(is_accepted(op.open(Timestamp{t})) && op.offer(Timestamp{t}, cloud, 400ms, 0).has_value());
    HOLDS(op.result(Timestamp{t}, fuseline::local, "boxes")->is(FUSELINE_OUTCOME_HELD));
  }
  HOLDS(is_refused(op.open(Timestamp{3}), FUSELINE_REASON_FULL) && op.held() == 2 && op.drain() && planner.forwarded == 2);
}
CASE(cpp_clock_set_back, "reads a clock that is set back, as one of a recording that begins again", "`set_back()` counts each such reading; nothing fires twice, and nothing until the clock has caught up") {
  Planner planner;
  auto at = 500ms;
  fuseline::ReadClock clock([&] { return at; });
  fuseline::Operator<std::string, Planner, fuseline::C3W16, decltype(clock)> op(planner, 16, Commit::eager, 1s, {{cloud, 31}}, clock);
  HOLDS(is_accepted(op.open(Timestamp{1}, 10ms)));
  at = 510ms;
  HOLDS(op.tick() && planner.missed == 1 && clock.set_back() == 0);
  at = -7ms;
  HOLDS(is_accepted(op.open(Timestamp{2}, 10ms)) && clock.set_back() == 1);
  HOLDS(op.next_due() == decltype(clock)::time_point(520ms));
  at = 519ms;
  HOLDS(op.tick() && planner.missed == 1 && clock.set_back() == 1);
  at = std::chrono::milliseconds::max();
  HOLDS(op.tick() && planner.missed == 2 && clock.now() == decltype(clock)::time_point::max());
}
CASE(cpp_negative_time_in_a_test, "lets a `ManualClock` go back, or beyond its last reading", "false, and no time goes by") {
  fuseline::ManualClock clock;
  HOLDS(clock.advance(3ms) && !clock.advance(-1ns) && !clock.advance(-0.1ns) && !clock.advance(std::chrono::hours::max()));
  HOLDS(!clock.advance(std::chrono::duration<double>(std::numeric_limits<double>::quiet_NaN())));
  HOLDS(clock.now() == fuseline::ManualClock::time_point(3ms));
}
CASE(cpp_full_window_of_values, "opens one more message when a full window holds values", "refused `full`; no value is lost") {
  Planner planner;
  Operator<fuseline::Own<5, 40>> op(planner, 40, Commit::eager, 1s, {{cloud, 1000}});
  for (std::uint64_t i = 0; i < 40; ++i) {
    HOLDS(is_accepted(op.open(Timestamp{i})));
    const auto offer = op.offer(Timestamp{i}, cloud, 400ms, 0);
    HOLDS(offer && offer->is(FUSELINE_OUTCOME_ADMITTED));
    HOLDS(op.result(Timestamp{i}, fuseline::local, "boxes")->is(FUSELINE_OUTCOME_HELD));
  }
  HOLDS(is_refused(op.open(Timestamp{40}), FUSELINE_REASON_FULL));
  ManualClock::at = 400ms;
  HOLDS(op.tick());
  ManualClock::at = {};
  HOLDS(planner.forwarded == 40 && planner.missed == 0 && op.held() == 0);
}
CASE(cpp_window_above_capacity, "gives a window above the capacity, or negative", "status `window`, no machine") {
  HOLDS(fuseline::Machine<>(17, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_WINDOW);
  HOLDS(fuseline::Machine<>(static_cast<std::uint32_t>(-1), Commit::eager, 1s, {}).status() == FUSELINE_STATUS_WINDOW);
}
CASE(cpp_too_many_clouds, "gives more clouds than the capacity, or than possible", "status `clouds`, no machine") {
  std::array<fuseline::Cloud, 20> many;
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = {Priority{i + 1}, 31};
  HOLDS(fuseline::Machine<>(16, Commit::eager, 1s, many.data(), 4).status() == FUSELINE_STATUS_CLOUDS);
  HOLDS(fuseline::Machine<>(16, Commit::eager, 1s, many.data(), 20).status() == FUSELINE_STATUS_CLOUDS);
}
CASE(cpp_window_of_64_bits, "gives a window of 64 bits, whose last 32 would do", "status `window`, no machine") {
  const std::size_t window = (std::size_t{1} << 32U) + 16;
  HOLDS(fuseline::Machine<>(window, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_WINDOW);
  HOLDS(fuseline::Machine<fuseline::AnyCapacity>(window, Commit::eager, 1s, {}).status() == FUSELINE_STATUS_CAPACITY);
}
CASE(cpp_no_array_of_clouds, "gives a number of clouds and no array", "status `null`, no machine") {
  HOLDS(fuseline::Machine<>(16, Commit::eager, 1s, nullptr, 2).status() == FUSELINE_STATUS_NULL);
}
CASE(cpp_wrong_clouds, "gives clouds with a limit of 0, a resume above the limit, one priority twice, local's, or one above 65535", "status `gate`, `twice` or `priority`, no machine") {
  const auto status = [](std::initializer_list<fuseline::Cloud> clouds) { return fuseline::Machine<>(16, Commit::eager, 1s, clouds).status(); };
  HOLDS(status({{cloud, 0}}) == FUSELINE_STATUS_GATE && status({{cloud, 3, 9}}) == FUSELINE_STATUS_GATE);
  HOLDS(status({{cloud, 3}, {cloud, 4}}) == FUSELINE_STATUS_TWICE);
  HOLDS(status({{fuseline::local, 3}}) == FUSELINE_STATUS_PRIORITY && status({{Priority{70000}, 3}}) == FUSELINE_STATUS_PRIORITY);
}
CASE(cpp_refused_as_accepted, "takes any answer to open or offer for a yes: `if (op.open(t))`", "false if it is refused, as in a full window or at a shut gate; `why()` has the reason") {
  Planner planner;
  Operator<> op(planner, 2, Commit::eager, 1s, {{cloud, 3}});
  unsigned accepted = 0, admitted = 0;
  for (std::uint64_t i = 0; i < 5; ++i) {
    if (op.open(Timestamp{i})) ++accepted;
    if (const auto offer = op.offer(Timestamp{i}, cloud, 10ms, i == 0 ? 0 : 3)) ++admitted;
  }
  HOLDS(accepted == 2 && admitted == 1);
  const auto full = op.open(Timestamp{9});
  HOLDS(!full && full.has_value() && full->why() == FUSELINE_REASON_FULL);
}
CASE(cpp_negative_backlog, "gives a negative backlog", "refused `queue`: the gate shuts") {
  Planner planner;
  Operator<> op(planner, 16, Commit::eager, 1s, {{cloud, 31}});
  const int backlog = -1;
  HOLDS(is_accepted(op.open(Timestamp{1})));
  HOLDS(is_refused(op.offer(Timestamp{1}, cloud, 10ms, static_cast<std::uint64_t>(backlog)), FUSELINE_REASON_QUEUE));
}
CASE(cpp_used_though_not_made, "uses a machine that could not be made", "no call has an answer; `status()` still says why") {
  Planner planner;
  Operator<> op(planner, 17, Commit::eager, 1s, {});
  HOLDS(!op && !op.open(Timestamp{1}) && !op.offer(Timestamp{1}, cloud, 1ms, 0) && !op.next_due() && !op.tick());
  HOLDS(!op.result(Timestamp{1}, fuseline::local, "boxes") && !op.fail(Timestamp{1}, fuseline::local));
  HOLDS(op.status() == FUSELINE_STATUS_WINDOW);
  fuseline::Machine<> machine(17, Commit::eager, 1s, {});
  HOLDS(!machine.look() && !machine.next_due() && machine.status() == FUSELINE_STATUS_WINDOW);
}
CASE(cpp_sink_of_one_output, "uses `progressive` with a sink that lacks `preliminary` or `final`", "status `commit`, no machine") {
  struct Endless : Planner {
    void preliminary(Timestamp, Priority, const std::string&) {}
  } endless;
  Planner planner;
  const Operator<> op(planner, 16, Commit::progressive, 1s, {{cloud, 31}});
  HOLDS(!op && op.status() == FUSELINE_STATUS_COMMIT);
  const fuseline::Operator<std::string, Endless> other(endless, 16, Commit::progressive, 1s, {{cloud, 31}});
  HOLDS(!other && other.status() == FUSELINE_STATUS_COMMIT);
}
CASE(cpp_overwritten, "overwrites the head of the storage", "no answers; `next_due()` too gives `foreign`, not that nothing is armed") {
  alignas(fuseline::Machine<>) static unsigned char room[sizeof(fuseline::Machine<>)];
  auto* machine = new (room) fuseline::Machine<>(16, Commit::eager, 1s, {});
  HOLDS(is_accepted(machine->open(Instant(), Timestamp{1}, 10ms, ignored)));
  HOLDS(machine->next_due() == Instant::from_monotonic(10ms) && machine->status() == FUSELINE_STATUS_DONE);
  std::memset(room, 0, 8);
  HOLDS(!machine->next_due() && machine->status() == FUSELINE_STATUS_FOREIGN);
  HOLDS(!machine->look() && machine->status() == FUSELINE_STATUS_FOREIGN);
}
CASE(cpp_clouds_of_a_temporary, "keeps the cancelled clouds of a temporary answer", "a copy: they stay right") {
  fuseline::Machine<> machine(16, Commit::eager, 1s, {{cloud, 31}, {Priority{2}, 31}});
  HOLDS(is_accepted(machine.open(Instant(), Timestamp{1}, {}, ignored)));
  for (const auto p : {cloud, Priority{2}}) HOLDS(machine.offer(Instant(), Timestamp{1}, p, 1ms, 0, ignored).has_value());
  std::vector<std::uint64_t> cancelled;
  for (const Priority p : machine.result(Instant(), Timestamp{1}, Priority{2}, ignored)->cancelled()) cancelled.push_back(p.number);
  HOLDS(cancelled == std::vector<std::uint64_t>{1});
}
CASE(cpp_firings_not_passed_on, "does not pass firings on to `Held`", "`Held` fills; `lost()` counts what has no room") {
  fuseline::Machine<> machine(16, Commit::eager, 1s, {{cloud, 31}});
  fuseline::Held<std::string, fuseline::C3W16> held(machine);
  for (std::uint64_t i = 0; i < 17; ++i) {
    const Instant now = Instant::from_monotonic(20ms * i);
    HOLDS(is_accepted(machine.open(now, Timestamp{i}, {}, ignored)));
    HOLDS(machine.offer(now, Timestamp{i}, cloud, 10ms, 0, ignored).has_value());
    const auto answer = machine.result(now, Timestamp{i}, fuseline::local, ignored);
    HOLDS(answer && !held.result(fuseline::local, "boxes", *answer));
  }
  HOLDS(held.lost() == 1 && held.size() == 16);
}
CASE(cpp_values_of_another_machine, "passes a firing of another machine to `Held`", "`lost()` counts it") {
  fuseline::Machine<> machine(16, Commit::eager, 1s, {{cloud, 31}}), other(16, Commit::eager, 1s, {{cloud, 31}});
  fuseline::Held<std::string, fuseline::C3W16> held(machine);
  HOLDS(is_accepted(other.open(Instant(), Timestamp{1}, {}, ignored)));
  HOLDS(other.offer(Instant(), Timestamp{1}, cloud, 10ms, 0, ignored).has_value());
  HOLDS(other.result(Instant(), Timestamp{1}, fuseline::local, ignored)->is(FUSELINE_OUTCOME_HELD));
  unsigned sent = 0;
  HOLDS(other.tick(Instant::from_monotonic(10ms), [&](const auto& firing) { sent += held.settled(firing) ? 1U : 0U; }).has_value());
  HOLDS(sent == 0 && held.lost() == 1);
}

// --- order ---

CASE(cpp_result_twice, "gives a result twice", "the second is dropped `superseded`; the sink gets one") {
  Planner planner;
  Operator<> op(planner, 16, Commit::eager, 1s, {{cloud, 31}});
  HOLDS(is_accepted(op.open(Timestamp{1})));
  HOLDS(op.result(Timestamp{1}, fuseline::local, "boxes")->is(FUSELINE_OUTCOME_FORWARDED));
  HOLDS(op.result(Timestamp{1}, fuseline::local, "boxes")->why() == FUSELINE_REASON_SUPERSEDED);
  HOLDS(planner.forwarded == 1);
}
CASE(cpp_first_output_for_the_last, "takes a preliminary output for the last, and gives no more results", "the sink gets `final` at the due instant; no value is held") {
  struct Revised : fuseline::Sink<std::string> {
    unsigned preliminary_len = 0, final_len = 0;
    void forward(Timestamp, Priority, const std::string&) { HOLDS(false); }
    void preliminary(Timestamp, Priority, const std::string& value) { preliminary_len += value.empty() ? 0U : 1U; }
    void final(Timestamp, Priority by) { final_len += by == fuseline::local ? 1U : 0U; }
    void miss(Timestamp) { HOLDS(false); }
  } sink;
  fuseline::Operator<std::string, Revised, fuseline::C3W16, ManualClock> op(sink, 16, Commit::progressive, 1s, {{cloud, 31}});
  HOLDS(is_accepted(op.open(Timestamp{1})) && op.offer(Timestamp{1}, cloud, 10ms, 0).has_value());
  HOLDS(op.result(Timestamp{1}, fuseline::local, "boxes")->is(FUSELINE_OUTCOME_PRELIMINARY));
  HOLDS(sink.preliminary_len == 1 && sink.final_len == 0 && op.held() == 0);
  HOLDS(is_refused(op.open(Timestamp{1}), FUSELINE_REASON_ORDER));
  ManualClock::at = 10ms;
  HOLDS(op.tick());
  ManualClock::at = {};
  HOLDS(sink.preliminary_len == 1 && sink.final_len == 1);
}
CASE(cpp_call_from_the_sink, "calls the operator from its own sink", "answered as any call, after what is due; an open may be refused `order`; no value is lost or repeated") {
  struct Nested : fuseline::Sink<std::string> {
    fuseline::Operator<std::string, Nested, fuseline::C3W16, ManualClock>* op = nullptr;
    unsigned forwarded = 0, refused = 0;
    void miss(Timestamp) { HOLDS(false); }
    void forward(Timestamp t, Priority, const std::string&) {
      ++forwarded;
      if (t.count >= 8) return;
      const auto opened = op->open(Timestamp{t.count + 8});
      refused += is_refused(opened, FUSELINE_REASON_ORDER) ? 1U : 0U;
      if (is_accepted(opened)) HOLDS(op->result(Timestamp{t.count + 8}, fuseline::local, "nested")->is(FUSELINE_OUTCOME_FORWARDED));
    }
  } sink;
  fuseline::Operator<std::string, Nested, fuseline::C3W16, ManualClock> op(sink, 16, Commit::eager, 1s, {{cloud, 31}});
  sink.op = &op;
  for (std::uint64_t i = 0; i < 8; ++i) {
    HOLDS(is_accepted(op.open(Timestamp{i})) && op.offer(Timestamp{i}, cloud, 10ms, 0).has_value());
    HOLDS(op.result(Timestamp{i}, fuseline::local, "boxes")->is(FUSELINE_OUTCOME_HELD));
  }
  ManualClock::at = 10ms;
  HOLDS(op.tick());
  ManualClock::at = {};
  HOLDS(sink.forwarded + sink.refused == 16 && sink.forwarded > 8 && op.held() == 0);
}

// --- values and sinks that do more than they should ---

// A value that calls back when it is destroyed, unless it was moved.
struct Handle {
  std::string text;
  std::function<void()> released;
  explicit Handle(std::string given, std::function<void()> then = {}) : text(std::move(given)), released(std::move(then)) {}
  Handle(Handle&& other) noexcept : text(std::move(other.text)), released(std::exchange(other.released, nullptr)) {}
  Handle& operator=(Handle&& other) noexcept {
    text = std::move(other.text);
    released = std::exchange(other.released, nullptr);
    return *this;
  }
  ~Handle() {
    if (released) released();
  }
};
struct Texts {
  std::vector<std::string> sent;
  std::vector<std::uint64_t> missed;
  void forward(Timestamp t, Priority, const Handle& value) { sent.push_back(std::to_string(t.count) + value.text); }
  void miss(Timestamp t) { missed.push_back(t.count); }
  void cancel(Timestamp, Priority) {}
  void fired(const fuseline::Firing&) {}
};
using Handles = fuseline::Operator<Handle, Texts, fuseline::C3W16, ManualClock>;
void opened_for_two(Handles& op, std::uint64_t t) {
  HOLDS(is_accepted(op.open(Timestamp{t})));
  for (const auto p : {cloud, Priority{2}}) HOLDS(op.offer(Timestamp{t}, p, 900ms, 0)->is(FUSELINE_OUTCOME_ADMITTED));
}

CASE(cpp_outdone_value_calls, "a better result destroys a held value, whose destructor gives another message's result", "each message keeps its own value; both are forwarded") {
  Texts sink;
  Handles op(sink, 16, Commit::patient, 1s, {{cloud, 31}, {Priority{2}, 31}});
  opened_for_two(op, 4), opened_for_two(op, 5);
  const auto give = [&] { HOLDS(op.result(Timestamp{5}, fuseline::local, Handle("five"))->is(FUSELINE_OUTCOME_HELD)); };
  HOLDS(op.result(Timestamp{4}, fuseline::local, Handle("worse", give))->is(FUSELINE_OUTCOME_HELD));
  HOLDS(op.result(Timestamp{4}, cloud, Handle("better"))->is(FUSELINE_OUTCOME_HELD) && op.held() == 2);
  for (const std::uint64_t t : {4U, 5U}) HOLDS(op.fail(Timestamp{t}, Priority{2}).has_value());
  HOLDS(op.fail(Timestamp{5}, cloud)->is(FUSELINE_OUTCOME_FORWARDED) && op.held() == 0);
  HOLDS((sink.sent == std::vector<std::string>{"4better", "5five"}));
}
CASE(cpp_last_value_calls, "the destructor of a value that is not sent opens and ends messages, with a full window", "answered as any call; no value is lost") {
  Texts sink;
  Handles op(sink, 16, Commit::eager, 1s, {{cloud, 31}, {Priority{2}, 31}});
  const auto next = [&] {
    HOLDS(is_accepted(op.open(Timestamp{20})) && op.offer(Timestamp{20}, cloud, 900ms, 0)->is(FUSELINE_OUTCOME_ADMITTED));
    HOLDS(op.result(Timestamp{20}, fuseline::local, Handle("next"))->is(FUSELINE_OUTCOME_HELD));
  };
  for (std::uint64_t t = 0; t < 16; ++t) {
    opened_for_two(op, t);
    HOLDS(op.result(Timestamp{t}, fuseline::local, Handle("held", t == 3 ? next : std::function<void()>()))->is(FUSELINE_OUTCOME_HELD));
  }
  HOLDS(op.result(Timestamp{3}, Priority{2}, Handle("best"))->is(FUSELINE_OUTCOME_FORWARDED) && op.held() == 16);
  HOLDS((sink.sent == std::vector<std::string>{"3best"}));
  ManualClock::at = 1s;
  HOLDS(op.tick());
  ManualClock::at = {};
  HOLDS(sink.sent.size() == 17 && sink.sent.back() == "20next" && op.held() == 0 && sink.missed.empty());
}
CASE(cpp_dropped_value_calls, "the destructor of a dropped value gives another message's result", "answered as any call; the other message is forwarded") {
  Texts sink;
  Handles op(sink, 16, Commit::eager, 1s, {});
  HOLDS(is_accepted(op.open(Timestamp{1})));
  const auto give = [&] { HOLDS(op.result(Timestamp{1}, fuseline::local, Handle("one"))->is(FUSELINE_OUTCOME_FORWARDED)); };
  HOLDS(op.result(Timestamp{2}, fuseline::local, Handle("unknown", give))->is(FUSELINE_OUTCOME_DROPPED));
  HOLDS((sink.sent == std::vector<std::string>{"1one"}));
}
CASE(cpp_value_outlives_operator, "the destructor of a value that is still held calls its operator while that ends", "status `foreign`, no answer") {
  Texts sink;
  unsigned refused = 0;
  {
    Handles op(sink, 16, Commit::eager, 1s, {{cloud, 31}, {Priority{2}, 31}});
    opened_for_two(op, 1), opened_for_two(op, 2);
    const auto give = [&] {
      const bool is_refused = !op.result(Timestamp{2}, fuseline::local, Handle("two")) && op.status() == FUSELINE_STATUS_FOREIGN;
      refused += is_refused ? 1U : 0U;
    };
    HOLDS(op.result(Timestamp{1}, fuseline::local, Handle("one", give))->is(FUSELINE_OUTCOME_HELD));
  }
  HOLDS(refused == 1 && sink.sent.empty());
}

struct Failing {
  std::string failing;  // which function throws, once
  std::vector<std::string> calls;
  std::function<void()> nested;
  void forward(Timestamp t, Priority, const std::string& value) {
    call("forward", t, value);
    if (nested) std::exchange(nested, nullptr)();
  }
  void miss(Timestamp t) { call("miss", t); }
  void cancel(Timestamp t, Priority p) { call("cancel", t, std::to_string(p.number)); }
  void fired(const fuseline::Firing& firing) { call("fired", firing.timestamp()); }
  void call(const char* what, Timestamp t, const std::string& value = "") {
    const std::string done = what + std::to_string(t.count) + value;
    if (done == failing) {
      failing.clear();
      throw std::runtime_error(done);
    }
    calls.push_back(done);
  }
};
using Throwing = fuseline::Operator<std::string, Failing, fuseline::C3W16, ManualClock>;
using Calls = std::vector<std::string>;
template <class Function>
std::string thrown_by(Function function) {
  try {
    function();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}
// Message 1 waits for a cloud with local's result, 2 without any, and both timers are due; 3 is open and has no timer.
void two_due_and_one_open(Throwing& op) {
  for (std::uint64_t t = 1; t < 4; ++t) HOLDS(is_accepted(op.open(Timestamp{t}, t == 2 ? std::optional<fuseline::Deadline>(10ms) : std::nullopt)));
  HOLDS(op.offer(Timestamp{1}, cloud, 10ms, 0)->is(FUSELINE_OUTCOME_ADMITTED));
  HOLDS(op.result(Timestamp{1}, fuseline::local, "one")->is(FUSELINE_OUTCOME_HELD));
  ManualClock::at = 10ms;
}

CASE(cpp_sink_throws_in_result, "a function of the sink throws for a message that is due, while another message's result is given", "all else is done and sent, then the exception is thrown; `sink_failures()` counts it") {
  for (const char* failing : {"fired1", "forward1one", "miss2", "forward3three"}) {
    Failing sink;
    Throwing op(sink, 16, Commit::eager, 1s, {{cloud, 31}});
    two_due_and_one_open(op);
    sink.failing = failing;
    HOLDS(thrown_by([&] { op.result(Timestamp{3}, fuseline::local, "three"); }) == failing);
    Calls expected{"fired1", "forward1one", "fired2", "miss2", "forward3three"};
    expected.erase(std::find(expected.begin(), expected.end(), failing));
    HOLDS(sink.calls == expected && op.held() == 0 && !op.next_due());
    HOLDS(op.sink_failures().len == 1 && op.sink_failures().last.count == static_cast<std::uint64_t>(std::strpbrk(failing, "123")[0] - '0'));
    HOLDS(op.tick());  // thrown once
    ManualClock::at = {};
  }
}
CASE(cpp_sink_throws_in_open, "a function of the sink throws while a message is opened or offered", "the answer comes, for the message would be open unknown; the next result, failure or tick throws") {
  Failing sink;
  Throwing op(sink, 16, Commit::eager, 1s, {{cloud, 31}});
  two_due_and_one_open(op);
  sink.failing = "forward1one";
  HOLDS(is_accepted(op.open(Timestamp{4})) && op.sink_failures().len == 1 && op.sink_failures().last == Timestamp{1});
  HOLDS(op.offer(Timestamp{4}, cloud, 10ms, 0)->is(FUSELINE_OUTCOME_ADMITTED));
  HOLDS(thrown_by([&] { op.fail(Timestamp{3}, fuseline::local); }) == "forward1one");
  HOLDS((sink.calls == Calls{"fired1", "fired2", "miss2", "miss3"}));
  HOLDS(op.result(Timestamp{4}, cloud, "four")->is(FUSELINE_OUTCOME_FORWARDED));
  ManualClock::at = {};
}
CASE(cpp_sink_throws_twice, "`forward` and `cancel` of one message throw", "the other cloud is cancelled, the first exception is thrown, both are counted") {
  struct Twice : Failing {
    void cancel(Timestamp t, Priority p) {
      calls.push_back("cancel" + std::to_string(p.number));
      if (p == cloud) throw std::runtime_error(std::to_string(t.count));
    }
  } sink;
  fuseline::Operator<std::string, Twice, fuseline::C3W16, ManualClock> op(sink, 16, Commit::eager, 1s, {{cloud, 31}, {Priority{2}, 31}, {Priority{3}, 31}});
  HOLDS(is_accepted(op.open(Timestamp{1})));
  for (const std::uint64_t p : {1U, 2U, 3U}) HOLDS(op.offer(Timestamp{1}, Priority{p}, 10ms, 0).has_value());
  sink.failing = "forward1best";
  HOLDS(thrown_by([&] { op.result(Timestamp{1}, Priority{3}, "best"); }) == "forward1best");
  HOLDS((sink.calls == Calls{"cancel1", "cancel2"}) && op.sink_failures().len == 2);
}
CASE(cpp_sink_throws_nested, "a sink calls the operator, whose sink throws in that call", "the outermost call throws, so that the first output is not lost with it") {
  Failing sink;
  Throwing op(sink, 16, Commit::eager, 1s, {{cloud, 31}});
  for (const std::uint64_t t : {1U, 2U}) HOLDS(is_accepted(op.open(Timestamp{t})));
  bool is_after = false;
  sink.nested = [&] {
    sink.failing = "forward2two";
    op.result(Timestamp{2}, fuseline::local, "two");
    is_after = true;
  };
  HOLDS(thrown_by([&] { op.result(Timestamp{1}, fuseline::local, "one"); }) == "forward2two");
  HOLDS(is_after && (sink.calls == Calls{"forward1one"}) && op.sink_failures().len == 1 && op.sink_failures().last == Timestamp{2});
}
CASE(cpp_move_throws, "the move of a value throws, as a copy that finds no memory", "thrown by the call that it belongs to; its message is missed, no other is touched") {
  struct Copied {
    std::string text;
    int* until;
    Copied(std::string given, int* budget) : text(std::move(given)), until(budget) {}
    Copied(const Copied& other) : text(other.text), until(other.until) {
      if (until != nullptr && --*until == 0) throw std::runtime_error(text);
    }
    Copied& operator=(const Copied&) = default;
  };
  struct Sink : fuseline::Sink<Copied> {
    Calls calls;
    void forward(Timestamp t, Priority, const Copied& value) { calls.push_back("forward" + std::to_string(t.count) + value.text); }
    void miss(Timestamp t) { calls.push_back("miss" + std::to_string(t.count)); }
  };
  unsigned thrown = 0;
  for (int copies = 1; copies < 12; ++copies) {
    Sink sink;
    fuseline::Operator<Copied, Sink, fuseline::C3W16, ManualClock> op(sink, 16, Commit::eager, 1s, {{cloud, 31}});
    for (const std::uint64_t t : {1U, 2U}) {
      HOLDS(is_accepted(op.open(Timestamp{t})) && op.offer(Timestamp{t}, cloud, 10ms, 0).has_value());
    }
    int budget = copies;
    const Copied one("one", &budget), two("two", nullptr);
    bool is_answered = false;
    unsigned errors = 0;
    // Made by the caller, before the call: its failure is the caller's.
    std::optional<Copied> mine;
    errors += thrown_by([&] { mine.emplace(one); }).empty() ? 0U : 1U;
    if (!mine) continue;
    errors += thrown_by([&] { is_answered = op.result(Timestamp{1}, fuseline::local, std::move(*mine)).has_value(); }).empty() ? 0U : 1U;
    HOLDS(op.result(Timestamp{2}, fuseline::local, two)->is(FUSELINE_OUTCOME_HELD));
    ManualClock::at = 10ms;
    errors += thrown_by([&] { HOLDS(op.tick()); }).empty() ? 0U : 1U;
    if (!is_answered) static_cast<void>(op.fail(Timestamp{1}, fuseline::local));  // the argument's copy threw: no call was made
    ManualClock::at = {};
    const bool is_whole = sink.calls == Calls{"forward1one", "forward2two"};
    HOLDS((is_whole ? errors == 0 : errors > 0) && op.held() == 0);
    if (!is_whole) {
      std::sort(sink.calls.begin(), sink.calls.end());
      HOLDS((sink.calls == Calls{"forward2two", "miss1"}));
      ++thrown;
    }
  }
  HOLDS(thrown > 2);
}
CASE(cpp_fired_throws, "the function for firings of a `Machine` throws", "the firing has happened and the input has not: the same call again has its answer") {
  fuseline::Machine<> machine(16, Commit::eager, 1s, {});
  HOLDS(is_accepted(machine.open(Instant(), Timestamp{1}, 10ms, ignored)) && is_accepted(machine.open(Instant(), Timestamp{2}, {}, ignored)));
  const Instant now = Instant::from_monotonic(10ms);
  const auto throws = [](const fuseline::Firing& firing) { throw std::runtime_error(std::to_string(firing.timestamp().count)); };
  HOLDS(thrown_by([&] { static_cast<void>(machine.result(now, Timestamp{2}, fuseline::local, throws)); }) == "1");
  HOLDS(machine.result(now, Timestamp{2}, fuseline::local, throws)->is(FUSELINE_OUTCOME_FORWARDED));
}
CASE(cpp_clock_throws, "a clock that is an object throws while a result is given", "thrown before anything is done: the value is gone, the same call with another has its answer") {
  Planner planner;
  bool is_broken = false;
  fuseline::ReadClock clock([&] {
    if (is_broken) throw std::runtime_error("clock");
    return 5ms;
  });
  fuseline::Operator<std::string, Planner, fuseline::C3W16, decltype(clock)> op(planner, 16, Commit::eager, 1s, {}, clock);
  HOLDS(is_accepted(op.open(Timestamp{1})));
  is_broken = true;
  HOLDS(thrown_by([&] { op.result(Timestamp{1}, fuseline::local, "boxes"); }) == "clock" && planner.forwarded == 0);
  is_broken = false;
  HOLDS(op.result(Timestamp{1}, fuseline::local, "boxes")->is(FUSELINE_OUTCOME_FORWARDED) && planner.forwarded == 1);
}
CASE(cpp_destroyed_by_its_sink, "a sink destroys its operator, as after the last message", "`std::terminate`: it does not go on in what is no longer there") {
  struct Last : fuseline::Sink<std::string> {
    std::unique_ptr<fuseline::Operator<std::string, Last, fuseline::C3W16, ManualClock>> op;
    void forward(Timestamp, Priority, const std::string&) { op.reset(); }
    void miss(Timestamp) { op.reset(); }
  };
  HOLDS(ends_the_program([] {
    Last last;
    last.op.reset(new fuseline::Operator<std::string, Last, fuseline::C3W16, ManualClock>(last, 16, Commit::eager, 1s, {}));
    static_cast<void>(last.op->open(Timestamp{1}));
    last.op->result(Timestamp{1}, fuseline::local, "boxes");
  }));
}
CASE(cpp_thread_ends_in_a_sink, "a thread is cancelled, or exits, in a function of the sink", "the thread ends; the operator can be used on") {
  struct Ending : Planner {
    bool ends = true;
    void forward(Timestamp t, Priority p, const std::string& value) {
      if (std::exchange(ends, false)) pthread_exit(nullptr);
      Planner::forward(t, p, value);
    }
  } sink;
  static fuseline::Operator<std::string, Ending, fuseline::C3W16, ManualClock>* shared;
  fuseline::Operator<std::string, Ending, fuseline::C3W16, ManualClock> op(sink, 16, Commit::eager, 1s, {});
  shared = &op;
  for (const std::uint64_t t : {1U, 2U}) HOLDS(is_accepted(op.open(Timestamp{t})));
  pthread_t thread;
  const auto give = [](void*) -> void* { return shared->result(Timestamp{1}, fuseline::local, "one"), nullptr; };
  HOLDS(pthread_create(&thread, nullptr, give, nullptr) == 0 && pthread_join(thread, nullptr) == 0);
  HOLDS(op.result(Timestamp{2}, fuseline::local, "two")->is(FUSELINE_OUTCOME_FORWARDED) && sink.forwarded == 1);
}
CASE(cpp_drained_by_its_sink, "a sink drains its operator", "each message ends once") {
  struct Draining : fuseline::Sink<std::string> {
    fuseline::Operator<std::string, Draining, fuseline::C3W16, ManualClock>* op = nullptr;
    unsigned forwarded = 0, missed = 0;
    void forward(Timestamp, Priority, const std::string&) {
      ++forwarded;
      HOLDS(op->drain());
    }
    void miss(Timestamp) {
      ++missed;
      HOLDS(op->drain());
    }
  } sink;
  fuseline::Operator<std::string, Draining, fuseline::C3W16, ManualClock> op(sink, 16, Commit::eager, 1s, {});
  sink.op = &op;
  for (std::uint64_t t = 0; t < 16; ++t) HOLDS(is_accepted(op.open(Timestamp{t})));
  HOLDS(op.result(Timestamp{3}, fuseline::local, "boxes").has_value() && sink.forwarded == 1 && sink.missed == 15);
}
CASE(cpp_stops_with_open_messages, "stops while messages wait for local, for a cloud, and for nothing that is due", "`drain()` ends each: the best result that is there, or a miss") {
  for (const Commit commit : {Commit::eager, Commit::patient}) {
    Texts sink;
    Handles op(sink, 16, commit, 1s, {{cloud, 31}, {Priority{2}, 31}});
    for (const std::uint64_t t : {1U, 2U, 3U}) opened_for_two(op, t);
    HOLDS(is_accepted(op.open(Timestamp{4})) && is_accepted(op.open(Timestamp{5})));
    HOLDS(op.result(Timestamp{4}, fuseline::local, Handle("sent"))->is(FUSELINE_OUTCOME_FORWARDED));
    HOLDS(op.result(Timestamp{1}, fuseline::local, Handle("worse"))->is(FUSELINE_OUTCOME_HELD));
    HOLDS(op.result(Timestamp{1}, cloud, Handle("better"))->is(FUSELINE_OUTCOME_HELD));
    HOLDS(op.result(Timestamp{2}, cloud, Handle("cloud"))->is(FUSELINE_OUTCOME_HELD));
    HOLDS(op.drain() && op.held() == 0 && !op.next_due());
    HOLDS((sink.sent == std::vector<std::string>{"4sent", "1better", "2cloud"} && sink.missed == std::vector<std::uint64_t>{3, 5}));
    HOLDS(op.drain() && sink.missed.size() == 2 && is_accepted(op.open(Timestamp{6})));
  }
  Failing failing;
  failing.failing = "miss1";
  Throwing op(failing, 16, Commit::eager, 1s, {});
  for (std::uint64_t t = 0; t < 16; ++t) HOLDS(is_accepted(op.open(Timestamp{t})));
  failing.nested = {};
  HOLDS(thrown_by([&] { op.drain(); }) == "miss1" && failing.calls.size() == 15 && !op.next_due());
}
CASE(cpp_stamp_again, "gives two messages one stamp: a driver's zeros, or a recording that is played twice", "`Stamps` gives the second no timestamp and counts it; a reply gets the first's") {
  fuseline::Stamps<std::int64_t, 4> stamps;
  HOLDS(stamps.add(0) == Timestamp{0} && !stamps.add(0) && stamps.repeated() == 1);
  for (const std::int64_t stamp : {-70, 20, 90}) HOLDS(stamps.add(stamp).has_value());
  HOLDS(stamps.find(-70) == Timestamp{1} && stamps.stamp_of(Timestamp{3}) == 90 && !stamps.stamp_of(Timestamp{4}));
  HOLDS(!stamps.add(20) && stamps.add(30) == Timestamp{4} && !stamps.find(0) && !stamps.stamp_of(Timestamp{0}));
  HOLDS(stamps.add(0) == Timestamp{5} && stamps.repeated() == 2 && !stamps.find(41));
}

// --- joins ---

using Pair = fuseline::Join<int, int>;
struct Joined {
  std::vector<std::uint64_t> keys;
  std::vector<fuseline::JoinDropReason> drops;
  Pair::Instant at;
  Pair join;
  explicit Joined(std::chrono::nanoseconds wait, std::uint64_t failing = UINT64_MAX)
      : join(wait, 4, [this, failing](const Pair::Set& set) {
          if (set.key == failing) throw std::runtime_error(std::to_string(set.key));
          keys.push_back(set.key);
        }, [this](const fuseline::JoinDrop& drop) { drops.push_back(drop.why); }) {}
  template <std::size_t Input>
  void arrive(std::uint64_t key) { join.arrive<Input>(at, key, std::make_shared<int>(1)); }
};
CASE(cpp_join_without_callbacks, "makes a join without a callback for sets, or for drops", "without the first, each set throws `std::bad_function_call`; without the second, `dropped()` counts") {
  Pair deaf(1s, 4, {}, {});
  const auto message = std::make_shared<int>(1);
  deaf.arrive<0>({}, 1, message), deaf.arrive<0>({}, 1, message);
  HOLDS(deaf.dropped() == 1);
  bool is_thrown = false;
  try {
    deaf.arrive<1>({}, 1, message);
  } catch (const std::bad_function_call&) {
    is_thrown = true;
  }
  HOLDS(is_thrown);
}
CASE(cpp_join_null_message, "gives a join a null pointer as a message", "dropped `null`") {
  Joined joined(1s);
  joined.join.arrive<0>({}, 1, nullptr);
  HOLDS((joined.drops == std::vector{fuseline::JoinDropReason::null}) && joined.join.dropped() == 1 && !joined.join.next_due());
}
CASE(cpp_join_waits_too_long, "lets a join wait beyond the clock's last reading", "it waits until then") {
  Joined joined(std::chrono::nanoseconds::max());
  joined.at += 5s;
  joined.arrive<0>(1);
  HOLDS(joined.join.next_due() == Pair::Instant::max() && joined.keys.empty());
}
CASE(cpp_join_callback_throws, "the callback for sets throws for a set that is due, while another message comes", "the other sets are given and the message is taken, then the exception is thrown") {
  Joined joined(1s, 1);
  for (const std::uint64_t key : {1U, 2U}) joined.arrive<0>(key);
  joined.at += 1s;
  HOLDS(thrown_by([&] { joined.arrive<0>(3); }) == "1" && joined.keys == std::vector<std::uint64_t>{2});
  joined.arrive<1>(3);
  HOLDS((joined.keys == std::vector<std::uint64_t>{2, 3}));
}
CASE(cpp_join_destroyed_by_a_callback, "a callback destroys its join", "`std::terminate`: it does not go on in what is no longer there") {
  HOLDS(ends_the_program([] {
    std::unique_ptr<fuseline::Join<int>> join;
    join.reset(new fuseline::Join<int>(1s, 4, [&](const auto&) { join.reset(); }, {}));
    join->arrive<0>({}, 1, std::make_shared<int>(1));
  }));
}

}  // namespace

int main(int argc, char** argv) { return run_cases(argc > 1 ? argv[1] : nullptr); }
