// Misuse of the C++ wrapper that does not compile. Without a case this compiles; with -DCASE=NAME's number it must not,
// and the compiler's text must match the case's pattern. `run` reads the lines that begin with "// case".
#include "fuseline.hpp"
#include "fuseline_clock.hpp"
#include "fuseline_join.hpp"
#include "fuseline_stamps.hpp"

#include "../clock.hpp"

#include <mutex>
#include <string>
#include <vector>

using namespace std::chrono_literals;
using namespace fuseline;

struct Planner : Sink<std::string> {
  void forward(Timestamp, Priority, const std::string&) {}
  void miss(Timestamp) {}
};
using Ticks = SetClock<std::chrono::duration<std::uint32_t, std::milli>>;
using Approximate = SetClock<std::chrono::duration<double>>;

[[maybe_unused]] static void right() {
  Planner planner;
  Operator<std::string, Planner> op(planner, 16, Commit::eager, 1s, {{Priority{1}, 31}});
  Machine<C3W16> machine(16, Commit::eager, 1s, {});
  Held<std::string, C3W16> held(machine);
  const Timestamp t{1};
  const Priority cloud{1};
  const auto offer = op.offer(t, cloud, 400ms, 0);
  const Instant now(std::chrono::steady_clock::now());
  static_cast<void>(offer), static_cast<void>(now);

#if CASE == 1
  // case 1 | plain number as a deadline | no .*conversion|cannot convert|no viable conversion
  const auto wrong = op.offer(t, cloud, 400, 0);
#elif CASE == 2
  // case 2 | floating-point number as a deadline | no .*conversion|cannot convert|no viable conversion
  const auto wrong = op.offer(t, cloud, 0.4, 0);
#elif CASE == 3
  // case 3 | plain number as local's deadline | no .*conversion|cannot convert|could not convert|no viable conversion
  const auto wrong = op.open(t, 400);
#elif CASE == 4
  // case 4 | plain number as an instant | no matching
  const Instant wrong(400);
#elif CASE == 5
  // case 5 | clock that can be set, as an instant | steady clock
  const Instant wrong(std::chrono::system_clock::now());
#elif CASE == 6
  // case 6 | clock that can be set, as an operator's | steady clock
  Operator<std::string, Planner, C3W16, std::chrono::system_clock> wrong(planner, 16, Commit::eager, 1s, {});
#elif CASE == 7
  // case 7 | clock with fractional ticks | whole numbers
  Operator<std::string, Planner, C3W16, Approximate> wrong(planner, 16, Commit::eager, 1s, {});
#elif CASE == 8
  // case 8 | operator without a greatest deadline | no matching
  Operator<std::string, Planner> wrong(planner, 16, Commit::eager, {{cloud, 31}});
#elif CASE == 9
  // case 9 | timestamp and priority swapped | convert|conversion
  const auto wrong = op.offer(cloud, t, 400ms, 0);
#elif CASE == 10
  // case 10 | plain number as a timestamp | convert|conversion
  const auto wrong = op.open(7);
#elif CASE == 11
  // case 11 | negative timestamp | narrowing|cannot be narrowed
  const Timestamp wrong{-1};
#elif CASE == 12
  // case 12 | negative priority | narrowing|cannot be narrowed
  const Priority wrong{-1};
#elif CASE == 13
  // case 13 | copied machine | deleted
  Machine<C3W16> wrong(machine);
#elif CASE == 14
  // case 14 | moved operator | deleted
  Operator<std::string, Planner> wrong(std::move(op));
#elif CASE == 15
  // case 15 | `Held` of another capacity than its machine | no matching
  Held<std::string, C1W4> wrong(machine);
#elif CASE == 16
  // case 16 | temporary as the sink | cannot bind|no matching
  Operator<std::string, Planner> wrong(Planner{}, 16, Commit::eager, 1s, {});
#elif CASE == 17
  // case 17 | more than 15 clouds | at most 15 clouds
  Machine<Own<16, 4>> wrong(4, Commit::eager, 1s, {});
#elif CASE == 18
  // case 18 | window of 0 | a window of 1 to 1024
  Machine<Own<3, 0>> wrong(4, Commit::eager, 1s, {});
#elif CASE == 19
  // case 19 | unused answer to open | unused-result|nodiscard
  op.open(t);
#elif CASE == 20
  // case 20 | unused answer to offer: a refused request would be sent | unused-result|nodiscard
  op.offer(t, cloud, 400ms, 0);
#elif CASE == 21
  // case 21 | unused forwarded value | unused-result|nodiscard
  held.settled(*offer);
#elif CASE == 22
  // case 22 | unused status of C | unused-result|nodiscard
  fuseline_end(nullptr);
#elif CASE == 23
  // case 23 | duration of a type that is no number | numbers of C\+\+
  struct Odd {
    long long number;
    constexpr bool operator>(Odd) const { return true; }
  };
  static_cast<void>(nanoseconds_of(std::chrono::duration<Odd>(Odd{1})));
#elif CASE == 24
  // case 24 | negative limit of a gate: it would never shut | narrowing|cannot be narrowed
  const Cloud wrong{cloud, -1};
#elif CASE == 25
  // case 25 | switch over outcomes without those of `progressive` | not handled in switch.*PRELIMINARY|PRELIMINARY.*not handled in switch
  switch (offer->outcome()) {
    case FUSELINE_OUTCOME_NOTHING:
    case FUSELINE_OUTCOME_ACCEPTED:
    case FUSELINE_OUTCOME_REFUSED:
    case FUSELINE_OUTCOME_ADMITTED:
    case FUSELINE_OUTCOME_HELD:
    case FUSELINE_OUTCOME_FORWARDED:
    case FUSELINE_OUTCOME_DROPPED:
    case FUSELINE_OUTCOME_MISSED:
    case FUSELINE_OUTCOME_WAITING: break;
  }
#elif CASE == 26
  // case 26 | time of day as an instant, by its duration | no matching
  const Instant wrong(std::chrono::system_clock::now().time_since_epoch());
#elif CASE == 27
  // case 27 | sink whose `forward` is misspelt | the sink lacks forward
  struct Misspelt : Sink<std::string> {
    void forwarded(Timestamp, Priority, const std::string&) {}
    void miss(Timestamp) {}
  } misspelt;
  Operator<std::string, Misspelt> wrong(misspelt, 16, Commit::eager, 1s, {});
#elif CASE == 28
  // case 28 | sink whose `miss` is misspelt, or has other arguments | the sink lacks forward
  struct Misspelt : Sink<std::string> {
    void forward(Timestamp, Priority, const std::string&) {}
    void miss(Timestamp, Priority) {}
  } misspelt;
  Operator<std::string, Misspelt> wrong(misspelt, 16, Commit::eager, 1s, {});
#elif CASE == 29
  // case 29 | operator for `Sink` itself instead of the sink's type | the sink lacks forward
  Sink<std::string>& base = planner;
  Operator<std::string, Sink<std::string>> wrong(base, 16, Commit::eager, 1s, {});
#elif CASE == 30
  // case 30 | operator for a sink's base, whose functions would be called | name the sink's own type
  struct Logged : Planner {
    void forward(Timestamp, Priority, const std::string&) {}
  } logged;
  Operator<std::string, Planner> wrong(logged, 16, Commit::eager, 1s, {});
#elif CASE == 31
  // case 31 | sink of another value | the sink lacks forward
  Operator<std::chrono::seconds, Planner> wrong(planner, 16, Commit::eager, 1s, {});
#elif CASE == 32
  // case 32 | clock that is an object, and is not given to its operator | this clock is an object
  Operator<std::string, Planner, C3W16, ManualClock> wrong(planner, 16, Commit::eager, 1s, {});
#elif CASE == 33
  // case 33 | temporary as the clock | cannot bind|no matching
  Operator<std::string, Planner, C3W16, ManualClock> wrong(planner, 16, Commit::eager, 1s, {}, ManualClock());
#elif CASE == 34
  // case 34 | clock that is read as a plain number | which has a unit
  ReadClock wrong([] { return 5; });
#elif CASE == 35
  // case 35 | clock of 32 bits, which wraps | whole numbers of 64 bits
  ReadClock wrong([] { return std::chrono::duration<std::uint32_t, std::milli>(5); });
#elif CASE == 36
  // case 36 | clock that is read in floating-point seconds | whole numbers of 64 bits
  ReadClock wrong([] { return std::chrono::duration<double>(5.0); });
#elif CASE == 37
  // case 37 | time of day as a clock's reading | which has a unit
  ReadClock wrong([] { return std::chrono::system_clock::now(); });
#elif CASE == 38
  // case 38 | operator's clock of 32 bits, which wraps | counts in 64 bits
  Operator<std::string, Planner, C3W16, Ticks> wrong(planner, 16, Commit::eager, 1s, {});
#elif CASE == 39
  // case 39 | value that cannot be moved | a value is an object that can be moved
  struct Locked : Sink<std::mutex> {
    void forward(Timestamp, Priority, const std::mutex&) {}
    void miss(Timestamp) {}
  } locked;
  Operator<std::mutex, Locked> wrong(locked, 16, Commit::eager, 1s, {});
#elif CASE == 40
  // case 40 | constant value | a value is an object that can be moved
  Operator<const std::string, Planner> wrong(planner, 16, Commit::eager, 1s, {});
#elif CASE == 41
  // case 41 | reference as the value | a value is an object that can be moved
  Held<std::string&, C3W16> wrong(machine);
#elif CASE == 42
  // case 42 | stamps in floating-point seconds | one that is rounded is not found
  Stamps<double> wrong;
#elif CASE == 43
  // case 43 | sink whose `forward` is private | the sink lacks forward
  class Private : public Sink<std::string> {
    void forward(Timestamp, Priority, const std::string&) {}
    void miss(Timestamp) {}
  } hidden;
  Operator<std::string, Private> wrong(hidden, 16, Commit::eager, 1s, {});
#elif CASE == 44
  // case 44 | sink whose `forward` takes priority and timestamp in the other order | the sink lacks forward
  struct Swapped : Sink<std::string> {
    void forward(Priority, Timestamp, const std::string&) {}
    void miss(Timestamp) {}
  } swapped;
  Operator<std::string, Swapped> wrong(swapped, 16, Commit::eager, 1s, {});
#elif CASE == 45
  // case 45 | sleep until the next due instant of another clock | conversion|convert|no viable
  const std::chrono::system_clock::time_point wrong = *op.next_due();
#elif CASE == 46
  // case 46 | deadline and backlog swapped | convert|conversion
  const auto wrong = op.offer(t, cloud, 0, 400ms);
#elif CASE == 47
  // case 47 | operator in a vector, which would move it | constructible|deleted|construct_at|implicitly-deleted
  std::vector<Operator<std::string, Planner>> wrong;
  wrong.emplace_back(planner, 16U, Commit::eager, Deadline(1s), std::initializer_list<Cloud>());
#elif CASE == 48
  // case 48 | recording by a machine that does not record | no member named .record|has no member named
  const bool wrong = op.record([](const char*) { return true; });
#elif CASE == 49
  // case 49 | reason compared as an outcome | convert|conversion|cannot initialize
  const bool wrong = offer->is(FUSELINE_REASON_LATE);
#elif CASE == 50
  // case 50 | message of a join's other input | convert|conversion|no viable
  Join<int, std::string> wrong(1s, 4, {}, {});
  wrong.arrive<0>({}, 1, std::make_shared<std::string>("boxes"));
#elif CASE == 51
  // case 51 | join that waits for a plain number | no matching
  Join<int, std::string> wrong(400, 4, {}, {});
#endif
}
