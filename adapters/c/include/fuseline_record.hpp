// A recorder for C++17, header only, over fuseline.hpp: the trace of an operator's run, which `fuseline check` judges.
//
//   fuseline::Operator<Boxes, Planner, fuseline::C3W16, std::chrono::steady_clock, fuseline::RecordedMachine> op(...);
//   std::ofstream file("run.jsonl");
//   op.record([&](std::string_view line) { return static_cast<bool>(file << line << std::flush); });
//
// SPEC.md, section 6, has the format. It allocates, unlike fuseline.hpp.

#ifndef FUSELINE_RECORD_HPP
#define FUSELINE_RECORD_HPP

#include "fuseline.hpp"

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>

namespace fuseline {

// A machine that records its inputs and decisions in the order of the decisions. If a sink calls the
// operator, that call's input comes first.
template <class Capacity = C3W16>
class RecordedMachine : public Machine<Capacity> {
  using Base = Machine<Capacity>;

 public:
  RecordedMachine(std::size_t window, Commit commit, Deadline greatest_deadline, std::initializer_list<Cloud> clouds)
      : RecordedMachine(window, commit, greatest_deadline, clouds.begin(), clouds.size()) {}
  RecordedMachine(std::size_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds, std::size_t size)
      : Base(window, commit, greatest_deadline, clouds, size), commit_(commit), greatest_(greatest_deadline.ns()) {
    const char* rule = commit == Commit::eager ? "eager" : commit == Commit::patient ? "patient" : "progressive";
    header_ = "{\"fuseline\":1,\"window\":" + std::to_string(window) + ",\"commit\":\"" + rule + "\",\"clouds\":[";
    for (std::size_t i = 0; i < size; ++i) {
      header_ += (i == 0 ? "{\"p\":" : ",{\"p\":") + std::to_string(clouds[i].priority.number);
      header_ += ",\"limit\":" + std::to_string(clouds[i].limit);
      if (clouds[i].resume) header_ += ",\"resume\":" + std::to_string(*clouds[i].resume);
      header_ += "}";
    }
    header_ += "]}\n";
  }

  // Begins the trace. `write` takes one line after the other, and returns false if it could not write it.
  // Returns false, and records nothing, if the machine was not made or already had an input, or if
  // `write` fails.
  [[nodiscard]] bool record(std::function<bool(std::string_view)> write) {
    if (!*this || is_used_ || write_) return false;
    write_ = std::move(write);
    lines_ = header_;
    flush();
    return is_recording();
  }

  // Returns true if every line so far was written. The trace ends at the first line that was not
  // written.
  bool is_recording() const noexcept { return write_ && !is_ended_; }

  template <class Fired>
  [[nodiscard]] Decision open(Instant now, Timestamp t, std::optional<Deadline> limit, Fired&& fired) {
    const auto answer = Base::open(now, t, limit, passing(fired));
    if (answer.has_value()) {
      input("open", *answer, &t);
      if (limit) member("deadline", to_machine(*limit));
      finish();
      if (answer->is(FUSELINE_OUTCOME_REFUSED)) why("refuse", *answer, nullptr);
      flush();
    }
    return answer;
  }

  template <class Fired>
  [[nodiscard]] Decision offer(Instant now, Timestamp t, Priority cloud, Deadline deadline, std::uint64_t backlog,
                               Fired&& fired) {
    const auto answer = Base::offer(now, t, cloud, deadline, backlog, passing(fired));
    if (answer.has_value()) {
      input("offer", *answer, &t);
      member("p", cloud.number);
      member("deadline", to_machine(deadline));
      member("backlog", backlog);
      finish();
      if (answer->is(FUSELINE_OUTCOME_REFUSED)) why("refuse", *answer, &cloud);
      if (answer->is(FUSELINE_OUTCOME_ADMITTED)) {
        begin("request", *answer, &cloud);
        member("due", answer->due().ns());
        finish();
      }
      flush();
    }
    return answer;
  }

  template <class Fired>
  [[nodiscard]] std::optional<Answer> result(Instant now, Timestamp t, Priority source, Fired&& fired,
                                             std::optional<Timestamp> meant_for = std::nullopt) {
    return settled("result", t, source, Base::result(now, t, source, passing(fired)), meant_for);
  }

  template <class Fired>
  [[nodiscard]] std::optional<Answer> fail(Instant now, Timestamp t, Priority source, Fired&& fired) {
    return settled("fail", t, source, Base::fail(now, t, source, passing(fired)));
  }

  template <class Fired>
  [[nodiscard]] std::optional<Answer> tick(Instant now, Fired&& fired) {
    const auto answer = Base::tick(now, passing(fired));
    if (answer) input("tick", *answer, nullptr), finish(), flush();
    return answer;
  }

 private:
  // Records a firing as the consequence of a tick, before `fired` is called: a call from within `fired`
  // may decide before the input.
  template <class Fired>
  auto passing(Fired& fired) {
    is_used_ = true;
    return [this, &fired](const Firing& firing) {
      if (!ticked_ || *ticked_ < firing.due()) {
        ticked_ = firing.at();
        input("tick", firing, nullptr);
        finish();
      }
      // Everything due at a tick fires at its instant, even what a call from within made fire.
      decided_ = ticked_;
      for (const Priority timer : firing.timers()) plain("timer", firing, timer);
      ending(firing);
      decided_.reset();
      flush();
      fired(firing);
    };
  }

  std::optional<Answer> settled(const char* ev, Timestamp t, Priority source, const std::optional<Answer>& answer,
                                std::optional<Timestamp> meant_for = std::nullopt) {
    if (!answer) return answer;
    input(ev, *answer, &t);
    member("p", source.number);
    if (meant_for) member("for", meant_for->count);
    finish();
    if (meant_for && !answer->is(FUSELINE_OUTCOME_DROPPED)) meant_[{t.count, source.number}] = meant_for->count;
    if (answer->is(FUSELINE_OUTCOME_HELD)) plain("hold", *answer, source);
    if (answer->is(FUSELINE_OUTCOME_DROPPED)) why("drop", *answer, &source);
    ending(*answer);
    flush();
    return answer;
  }

  void ending(const Answer& answer) {
    const bool is_last = answer.is(FUSELINE_OUTCOME_FORWARDED);
    if (is_last || answer.is(FUSELINE_OUTCOME_PRELIMINARY)) emit(answer);
    for (const Priority cloud : answer.cancelled()) plain("cancel", answer, cloud);
    if (answer.is(FUSELINE_OUTCOME_FINAL) || (is_last && commit_ == Commit::progressive)) plain("final", answer, answer.by());
    const bool is_missed = answer.is(FUSELINE_OUTCOME_MISSED);
    if (is_missed) begin("miss", answer, nullptr), finish();
    if (is_last || is_missed || answer.is(FUSELINE_OUTCOME_FINAL)) {
      const std::uint64_t t = answer.timestamp().count;
      meant_.erase(meant_.lower_bound({t, 0}), meant_.upper_bound({t, ~std::uint64_t{0}}));
    }
  }

  // Records an output with the message that its value is meant for, if the reply named one.
  void emit(const Answer& answer) {
    const Priority source = answer.by();
    begin("emit", answer, &source);
    const auto meant = meant_.find({answer.timestamp().count, source.number});
    if (meant != meant_.end()) member("for", meant->second);
    finish();
  }

  void input(const char* ev, const Answer& answer, const Timestamp* t) {
    line_ = std::string("{\"ev\":\"") + ev + "\",\"at\":" + std::to_string(decided_.value_or(answer.at()).ns());
    if (t != nullptr) member("t", t->count);
  }
  void begin(const char* ev, const Answer& answer, const Priority* p) {
    const Timestamp t = answer.timestamp();
    input(ev, answer, &t);
    if (p != nullptr) member("p", p->number);
  }
  void plain(const char* ev, const Answer& answer, Priority p) { begin(ev, answer, &p), finish(); }
  void why(const char* ev, const Answer& answer, const Priority* p) {
    begin(ev, answer, p);
    line_ += std::string(",\"why\":\"") + fuseline_reason_name(answer.why()) + "\"";
    finish();
  }
  void member(const char* key, std::uint64_t number) { line_ += std::string(",\"") + key + "\":" + std::to_string(number); }
  void finish() {
    if (is_recording()) lines_ += line_ + "}\n";
  }

  // Writes the decisions line by line. If `write` calls the operator, the decisions of that call are written
  // afterwards.
  void flush() {
    if (is_writing_) return;
    is_writing_ = true;
    for (std::size_t end = 0; is_recording() && (end = lines_.find('\n')) != std::string::npos;) {
      const std::string line = lines_.substr(0, end + 1);
      lines_.erase(0, end + 1);
      put(line);
    }
    is_writing_ = false;
  }

  // Writes a line. The trace ends at the first line that fails, because a gap would be judged as if the
  // missing lines had not happened.
  void put(std::string_view line) {
    bool is_written = false;
#if defined(__cpp_exceptions)
    try {
      is_written = write_(line);
    } catch (...) {
      if (!std::current_exception()) throw;  // the thread is cancelled, or exits
    }
#else
    is_written = write_(line);
#endif
    is_ended_ = !is_written;
  }

  // Converts a deadline: one above the greatest is 0 to the machine.
  std::uint64_t to_machine(Deadline deadline) const noexcept { return deadline.ns() > greatest_ ? 0 : deadline.ns(); }

  Commit commit_;
  std::uint64_t greatest_;
  std::string header_, line_, lines_;
  std::function<bool(std::string_view)> write_;
  // The message that the value of each result is meant for, by timestamp and source, until the message ends.
  std::map<std::pair<std::uint64_t, std::uint64_t>, std::uint64_t> meant_;
  std::optional<Instant> ticked_, decided_;
  bool is_used_ = false, is_writing_ = false, is_ended_ = false;
};

}  // namespace fuseline

#endif  // FUSELINE_RECORD_HPP
