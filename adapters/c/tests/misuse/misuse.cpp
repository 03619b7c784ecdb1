// The C++ wrapper, misused. The library holds 3 clouds with a window of 16, and 5 with 40.
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cases.h"
#include "fuseline.hpp"

namespace {

using namespace std::chrono_literals;
using fuseline::Answer;
using fuseline::Commit;
using fuseline::Instant;
using fuseline::Priority;
using fuseline::Timestamp;

constexpr Priority cloud{1};
const auto ignored = [](const fuseline::Firing&) {};

struct ManualClock {
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<ManualClock>;
  static constexpr bool is_steady = true;
  static time_point now() noexcept { return time_point(at); }
  static duration at;
};
ManualClock::duration ManualClock::at{};

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
  const Instant due(20ms), now(50ms);
  HOLDS(due - now == -30ms && now - due == 30ms);
  HOLDS(Instant(std::chrono::duration<std::uint64_t, std::nano>::max()) - Instant() == std::chrono::nanoseconds::max());
}
CASE(cpp_instant_before_start, "gives a reading before the clock's start", "counts as the start") {
  HOLDS(Instant(-5ms) == Instant());
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
  struct Endless : fuseline::Sink<std::string> {
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
  HOLDS(machine->next_due() == Instant(10ms) && machine->status() == FUSELINE_STATUS_DONE);
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
    const Instant now(20ms * i);
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
  HOLDS(other.tick(Instant(10ms), [&](const auto& firing) { sent += held.settled(firing) ? 1U : 0U; }).has_value());
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

}  // namespace

int main(int argc, char** argv) { return run_cases(argc > 1 ? argv[1] : nullptr); }
