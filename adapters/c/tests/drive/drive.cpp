// A driver over the C++ wrapper: the ready operator with a virtual clock and values that can only be moved. It answers
// what `fuseline drive` asks, and breaks off if a value is lost, swapped or kept too long.
//
//     fuseline drive -- ./drive-cpp
//
// With OBJECTS the capacity is chosen at run time, and the clock is an object.

#include <memory>

#include "../clock.hpp"
#include "fuseline.hpp"
#include "fuseline_capacity.hpp"
#include "line.h"

namespace {

using fuseline::Answer;
using fuseline::Priority;
using fuseline::Timestamp;

using Virtual = SetClock<std::chrono::duration<std::uint64_t, std::nano>>;
struct VirtualObject : Virtual {
  using time_point = std::chrono::time_point<VirtualObject>;
  time_point now() const noexcept { return time_point(at); }
};

// The message and the source of a result, so that a value that is forwarded for another one is seen.
struct Value {
  Timestamp t;
  Priority source;
};
using Owned = std::unique_ptr<Value>;

said said_lines;

void line_of(const char* ev, const Answer& answer, const std::uint64_t* p) {
  say_head(&said_lines, ev, answer.at().ns(), answer.timestamp().count);
  if (p != nullptr) say_member(&said_lines, "p", *p);
}

struct Lines : fuseline::Sink<Owned> {
  // The instant of the decisions: the machine's, which does not go back.
  std::uint64_t at = 0;

  void preliminary(Timestamp t, Priority by, Owned value) { forward(t, by, std::move(value)); }
  void final(Timestamp t, Priority by) { say("final", t, by); }
  void forward(Timestamp t, Priority by, Owned value) {
    if (!value || value->t != t || value->source != by) _exit(3);
    say("emit", t, by);
  }
  void miss(Timestamp t) {
    say_head(&said_lines, "miss", at, t.count);
    say_end(&said_lines);
  }
  void cancel(Timestamp t, Priority cloud) { say("cancel", t, cloud); }
  void fired(const fuseline::Firing& firing) {
    if (said_lines.len > sizeof said_lines.text / 2) say_now(&said_lines);
    for (const Priority p : firing.timers()) say("timer", firing.timestamp(), p);
  }

 private:
  void say(const char* ev, Timestamp t, Priority p) const {
    say_head(&said_lines, ev, at, t.count);
    say_member(&said_lines, "p", p.number);
    say_end(&said_lines);
  }
};

class Driver {
 public:
  bool reply(const char* text) {
    if (line_parse(text, &line_) == 0) return false;
    return line_.kind == LINE_HEADER ? start() : ask();
  }

 private:
#ifdef OBJECTS
  using Operator = fuseline::Operator<Owned, Lines, fuseline::AnyCapacity, VirtualObject>;
#else
  using Operator = fuseline::Operator<Owned, Lines, fuseline::C15W1024, Virtual>;
#endif

  bool start() {
    std::array<fuseline::Cloud, LINE_CLOUDS> clouds;
    for (unsigned i = 0; i < line_.clouds_len; ++i) {
      clouds[i] = {Priority{line_.clouds[i].p}, line_.clouds[i].limit, line_.clouds[i].resume};
    }
    commit_ = static_cast<fuseline::Commit>(line_.commit);
    Virtual::at = {};
    sink_.at = 0;
#ifdef OBJECTS
    operator_ = std::make_unique<Operator>(sink_, static_cast<std::uint32_t>(line_.window), commit_, Virtual::duration::max(),
                                           clouds.data(), line_.clouds_len, clock_);
#else
    operator_ = std::make_unique<Operator>(sink_, static_cast<std::uint32_t>(line_.window), commit_, Virtual::duration::max(),
                                           clouds.data(), line_.clouds_len);
#endif
    return static_cast<bool>(*operator_);
  }

  bool ask() {
    if (!operator_) return false;
    const Timestamp t{line_.t};
    const Priority p{line_.p};
    Virtual::at = Virtual::duration(line_.at);
    sink_.at = line_.at > sink_.at ? line_.at : sink_.at;
    std::optional<fuseline::Deadline> limit;
    if (line_.has_deadline != 0) limit = Virtual::duration(line_.deadline);
    std::optional<Answer> answer;
    switch (line_.kind) {
      case LINE_OPEN: answer = operator_->open(t, limit); break;
      case LINE_OFFER: answer = operator_->offer(t, p, *limit, line_.backlog); break;
      case LINE_RESULT: answer = operator_->result(t, p, Owned(new Value{t, p})); break;
      case LINE_FAIL: answer = operator_->fail(t, p); break;
      case LINE_TICK: return operator_->tick();
      default: return false;
    }
    if (!answer) return false;
    say(*answer);
    // F9: the end of an output that is the last; nothing is held.
    if (commit_ == fuseline::Commit::progressive) {
      if (answer->is(FUSELINE_OUTCOME_FORWARDED)) sink_.final(answer->timestamp(), answer->by());
      if (operator_->held() != 0) return false;
    }
    const auto due = operator_->next_due();
    return !due || due->time_since_epoch() > Virtual::at || sink_.at > line_.at;
  }

  // Writes a decision that did not go to the sink.
  void say(const Answer& answer) const {
    const char* ev = nullptr;
    switch (answer.outcome()) {
      case FUSELINE_OUTCOME_REFUSED: ev = "refuse"; break;
      case FUSELINE_OUTCOME_ADMITTED: ev = "request"; break;
      case FUSELINE_OUTCOME_HELD: ev = "hold"; break;
      case FUSELINE_OUTCOME_DROPPED: ev = "drop"; break;
      default: return;
    }
    line_of(ev, answer, line_.kind == LINE_OPEN ? nullptr : &line_.p);
    if (answer.is(FUSELINE_OUTCOME_ADMITTED)) {
      say_member(&said_lines, "due", answer.due().ns());
    }
    if (answer.why() != FUSELINE_REASON_NONE) say_why(&said_lines, fuseline_reason_name(answer.why()));
    say_end(&said_lines);
  }

  line line_{};
  fuseline::Commit commit_{};
  Lines sink_;
#ifdef OBJECTS
  VirtualObject clock_;
#endif
  std::unique_ptr<Operator> operator_;
};

}  // namespace

int main() {
  static Driver driver;
  return serve(&said_lines, [](const char* text) { return driver.reply(text) ? 1 : 0; });
}
