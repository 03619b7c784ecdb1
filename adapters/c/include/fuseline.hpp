// Fuseline for C++17, header only, over fuseline.h: no exceptions, no RTTI, no allocation.
//
//   Machine<Capacity>   the machine: answers, as in C, with the types of C++
//   Held<Value, C>      the values of held results, move-only ones too
//   Operator<...>       both with a clock and a sink: an operator for one thread
//
// SPEC.md has the rules (F), promises (P) and ambiguities (A) that are named here.

#ifndef FUSELINE_HPP
#define FUSELINE_HPP

#include "fuseline.h"

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>

namespace fuseline {

// The nanoseconds of any std::chrono duration, rounded down: 0 if it is negative or not a number, the greatest number if
// it does not fit.
template <class Rep, class Period>
[[nodiscard]] constexpr std::uint64_t nanoseconds_of(const std::chrono::duration<Rep, Period>& duration) noexcept {
  static_assert(std::is_arithmetic_v<Rep>, "Fuseline takes durations that count in numbers of C++");
  using Factor = std::ratio_divide<Period, std::nano>;
  constexpr std::uint64_t greatest = std::numeric_limits<std::uint64_t>::max();
  if (!(duration.count() > Rep{})) return 0;
  if constexpr (std::is_floating_point_v<Rep>) {
    const long double exact = static_cast<long double>(duration.count()) * Factor::num / Factor::den;
    return exact < 18446744073709551615.0L ? static_cast<std::uint64_t>(exact) : greatest;
  } else {
    static_assert(sizeof(Rep) <= sizeof(std::uint64_t), "Fuseline takes durations of at most 64 bits");
    constexpr auto num = static_cast<std::uint64_t>(Factor::num);
    constexpr auto den = static_cast<std::uint64_t>(Factor::den);
    static_assert(num <= greatest / den, "the unit of this duration is too odd");
    const std::uint64_t count{static_cast<std::make_unsigned_t<Rep>>(duration.count())};
    const std::uint64_t whole = count / den;
    const std::uint64_t rest = count % den * num / den;
    return whole > (greatest - rest) / num ? greatest : whole * num + rest;
  }
}

namespace detail {
using Nanoseconds = std::chrono::duration<std::uint64_t, std::nano>;  // the machine's own: without a sign
}  // namespace detail

// How long a request, or local, may take. Any std::chrono duration converts: one of 0 or less is refused `deadline`, and
// one that is too long is the longest. A plain number does not convert: it has no unit.
class Deadline {
 public:
  template <class Rep, class Period>
  constexpr Deadline(const std::chrono::duration<Rep, Period>& duration) noexcept : ns_(nanoseconds_of(duration)) {}
  constexpr std::uint64_t ns() const noexcept { return ns_; }

 private:
  std::uint64_t ns_;
};

// A reading of your monotonic clock, in nanoseconds from any fixed start. One before it is 0, one too late the last.
// A difference has its sign: it is std::chrono::nanoseconds, and saturates.
class Instant {
 public:
  constexpr Instant() noexcept = default;
  template <class Rep, class Period>
  explicit constexpr Instant(const std::chrono::duration<Rep, Period>& since_start) noexcept
      : ns_(nanoseconds_of(since_start)) {}
  template <class Clock, class Elapsed>
  explicit constexpr Instant(const std::chrono::time_point<Clock, Elapsed>& reading) noexcept
      : Instant(reading.time_since_epoch()) {
    static_assert(Clock::is_steady, "Fuseline takes a steady clock: others are set back and forth");
  }
  constexpr std::uint64_t ns() const noexcept { return ns_; }

  friend constexpr bool operator==(Instant a, Instant b) noexcept { return a.ns_ == b.ns_; }
  friend constexpr bool operator!=(Instant a, Instant b) noexcept { return a.ns_ != b.ns_; }
  friend constexpr bool operator<(Instant a, Instant b) noexcept { return a.ns_ < b.ns_; }
  friend constexpr bool operator>(Instant a, Instant b) noexcept { return a.ns_ > b.ns_; }
  friend constexpr bool operator<=(Instant a, Instant b) noexcept { return a.ns_ <= b.ns_; }
  friend constexpr bool operator>=(Instant a, Instant b) noexcept { return a.ns_ >= b.ns_; }
  friend constexpr std::chrono::nanoseconds operator-(Instant a, Instant b) noexcept {
    return a < b ? -apart(b, a) : apart(a, b);
  }

 private:
  static constexpr std::chrono::nanoseconds apart(Instant later, Instant earlier) noexcept {
    using Rep = std::chrono::nanoseconds::rep;
    const std::uint64_t ns = later.ns_ - earlier.ns_;
    constexpr auto most = static_cast<std::uint64_t>(std::numeric_limits<Rep>::max());
    return std::chrono::nanoseconds(static_cast<Rep>(ns < most ? ns : most));
  }

  std::uint64_t ns_ = 0;
};

// The counter of an operator's messages; no time of day.
struct Timestamp {
  std::uint64_t count = 0;
  friend constexpr bool operator==(Timestamp a, Timestamp b) noexcept { return a.count == b.count; }
  friend constexpr bool operator!=(Timestamp a, Timestamp b) noexcept { return a.count != b.count; }
  friend constexpr bool operator<(Timestamp a, Timestamp b) noexcept { return a.count < b.count; }
};

// How good a source's results are: 0 is local, clouds have 1 to 65535, the greater wins.
struct Priority {
  std::uint64_t number = 0;
  friend constexpr bool operator==(Priority a, Priority b) noexcept { return a.number == b.number; }
  friend constexpr bool operator!=(Priority a, Priority b) noexcept { return a.number != b.number; }
  friend constexpr bool operator<(Priority a, Priority b) noexcept { return a.number < b.number; }
};
inline constexpr Priority local{0};

enum class Commit : std::uint32_t {
  eager = FUSELINE_COMMIT_EAGER,
  patient = FUSELINE_COMMIT_PATIENT,
  progressive = FUSELINE_COMMIT_PROGRESSIVE,
};
using Status = fuseline_status;
using Outcome = fuseline_outcome;
using Reason = fuseline_reason;

// How much a machine has room for, and the storage for it. A library that was not built for exactly this many clouds and
// this window refuses to make the machine, FUSELINE_STATUS_CAPACITY.
template <std::size_t Clouds, std::size_t Window>
struct Capacity {
  static_assert(Clouds < FUSELINE_SOURCES, "a machine has at most 15 clouds");
  static_assert(Window >= 1 && Window <= 1024, "a machine has a window of 1 to 1024");
  static constexpr std::uint32_t id = FUSELINE_CAPACITY_OF(Clouds, Window);
  static constexpr std::size_t window = Window;
  using Storage = std::array<std::uint64_t, FUSELINE_STORAGE_BYTES(Clouds, Window) / 8U>;
};
using C1W4 = Capacity<1, 4>;
using C3W16 = Capacity<3, 16>;
using C7W64 = Capacity<7, 64>;
using C15W1024 = Capacity<15, 1024>;
// Those by which the library was built: FUSELINE_OWN_CLOUDS and FUSELINE_OWN_WINDOW.
template <std::size_t Clouds, std::size_t Window>
using Own = Capacity<Clouds, Window>;

// One cloud as configured: its gate shuts at `limit` queued requests and opens at `resume`, limit - 1 unless given.
struct Cloud {
  Priority priority;
  std::uint64_t limit = 1;
  std::optional<std::uint64_t> resume = std::nullopt;
};

// Some priorities, ascending: a copy, which outlives the answer that it came from.
class Priorities {
 public:
  class iterator {
   public:
    explicit constexpr iterator(const std::uint16_t* at) noexcept : at_(at) {}
    constexpr Priority operator*() const noexcept { return Priority{*at_}; }
    constexpr iterator& operator++() noexcept {
      ++at_;
      return *this;
    }
    constexpr bool operator!=(iterator other) const noexcept { return at_ != other.at_; }

   private:
    const std::uint16_t* at_;
  };
  Priorities(const std::uint16_t (&members)[FUSELINE_SOURCES], std::uint32_t size) noexcept : size_(size) {
    for (std::size_t i = 0; i < members_.size(); ++i) members_[i] = members[i];
  }
  iterator begin() const noexcept { return iterator(members_.data()); }
  iterator end() const noexcept { return iterator(members_.data() + size_); }
  std::size_t size() const noexcept { return size_; }

 private:
  std::array<std::uint16_t, FUSELINE_SOURCES> members_{};
  std::uint32_t size_;
};

// What became of an input.
class Answer {
 public:
  explicit Answer(const fuseline_answer& plain) noexcept : plain_(plain) {}
  Instant at() const noexcept { return Instant(detail::Nanoseconds(plain_.at)); }
  Timestamp timestamp() const noexcept { return Timestamp{plain_.t}; }
  Outcome outcome() const noexcept { return plain_.outcome; }
  bool is(Outcome outcome) const noexcept { return plain_.outcome == outcome; }
  // Why it was refused or dropped; FUSELINE_REASON_NONE if it was neither.
  Reason why() const noexcept { return plain_.why; }
  // Whose result is forwarded, preliminary or final.
  Priority by() const noexcept { return Priority{plain_.by}; }
  // An admitted request's, or that of the timers that fired.
  Instant due() const noexcept { return Instant(detail::Nanoseconds(plain_.due)); }
  // The clouds whose results are no longer wanted.
  Priorities cancelled() const noexcept { return {plain_.cancelled, plain_.cancelled_len}; }

 protected:
  fuseline_answer plain_;
};

// What timers led to that fired before an input (F5).
class Firing : public Answer {
 public:
  using Answer::Answer;
  Priorities timers() const noexcept { return {plain_.timers, plain_.timers_len}; }
};

// One operator's machine in storage of its own. It stays where it was made.
//
// Each input gives the firings that come before it to `fired`, a function of a const Firing&, and answers what became
// of itself, or nothing if status() says that the machine could not be asked. A deadline above `greatest_deadline` is
// refused `deadline`: that is what the system may wait for a message in the worst case.
template <class Capacity = C3W16>
class Machine {
 public:
  Machine(std::uint32_t window, Commit commit, Deadline greatest_deadline, std::initializer_list<Cloud> clouds) noexcept
      : Machine(window, commit, greatest_deadline, clouds.begin(), clouds.size()) {}

  Machine(std::uint32_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds,
          std::size_t size) noexcept {
    std::array<fuseline_cloud, FUSELINE_SOURCES> plain{};
    if (size > plain.size()) {
      status_ = FUSELINE_STATUS_CLOUDS;
      return;
    }
    for (std::size_t i = 0; i < size; ++i) {
      const Cloud& cloud = clouds[i];
      plain[i] = {cloud.priority.number, cloud.limit, cloud.resume.value_or(cloud.limit > 0 ? cloud.limit - 1 : 0)};
    }
    const fuseline_config config{FUSELINE_CONFIG,
                                 Capacity::id,
                                 static_cast<std::uint32_t>(commit),
                                 window,
                                 static_cast<std::uint32_t>(size),
                                 plain.data(),
                                 greatest_deadline.ns()};
    status_ = fuseline_init(storage_.data(), sizeof storage_, &config, &machine_);
  }

  ~Machine() {
    if (machine_ != nullptr) static_cast<void>(fuseline_end(machine_));
  }
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;

  // FUSELINE_STATUS_DONE, or why the last call to the machine was in vain; if it could not be made, why not, for ever.
  Status status() const noexcept { return status_; }
  explicit operator bool() const noexcept { return machine_ != nullptr; }

  // F1: a message came. `limit` is how long local may take for it.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> open(Instant now, Timestamp t, std::optional<Deadline> limit, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return limit ? fuseline_open_within(machine_, now.ns(), t.count, limit->ns(), answer)
                   : fuseline_open(machine_, now.ns(), t.count, answer);
    });
  }

  // F2: may it be sent to this cloud, in whose queue `backlog` others wait?
  template <class Fired>
  [[nodiscard]] std::optional<Answer> offer(Instant now, Timestamp t, Priority cloud, Deadline deadline,
                                            std::uint64_t backlog, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_offer(machine_, now.ns(), t.count, cloud.number, deadline.ns(), backlog, answer);
    });
  }

  // F3: the source's result came.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> result(Instant now, Timestamp t, Priority source, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_result(machine_, now.ns(), t.count, source.number, answer);
    });
  }

  // F4: no result will come from the source.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> fail(Instant now, Timestamp t, Priority source, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_fail(machine_, now.ns(), t.count, source.number, answer);
    });
  }

  // F0: time went by.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> tick(Instant now, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) { return fuseline_tick(machine_, now.ns(), answer); });
  }

  // When a timer is due next; tick then. Nothing if no timer is armed, or if status() is not FUSELINE_STATUS_DONE.
  [[nodiscard]] std::optional<Instant> next_due() noexcept {
    std::uint64_t due = 0;
    if (!answered([&] { return fuseline_next_due(machine_, &due); })) return std::nullopt;
    return Instant(detail::Nanoseconds(due));
  }

  // What the machine knows of itself.
  [[nodiscard]] std::optional<fuseline_state> look() noexcept {
    fuseline_state state{};
    if (!answered([&] { return fuseline_look(machine_, &state); })) return std::nullopt;
    return state;
  }

 private:
  template <class Fired, class Call>
  std::optional<Answer> ask(Fired& fired, Call call) {
    if (machine_ == nullptr) return std::nullopt;  // status() still says why it could not be made
    fuseline_answer answer{};
    while ((status_ = call(&answer)) == FUSELINE_STATUS_AGAIN) {
      const Firing firing(answer);
      fired(firing);
    }
    if (status_ != FUSELINE_STATUS_DONE) return std::nullopt;
    return Answer(answer);
  }

  // Whether a question has an answer. That nothing is there is no failure.
  template <class Question>
  bool answered(Question question) noexcept {
    if (machine_ == nullptr) return false;
    const Status status = question();
    status_ = status == FUSELINE_STATUS_NONE ? FUSELINE_STATUS_DONE : status;
    return status == FUSELINE_STATUS_DONE;
  }

  alignas(8) typename Capacity::Storage storage_{};
  fuseline_machine* machine_ = nullptr;
  Status status_ = FUSELINE_STATUS_NULL;
};

// The values of held results: of each open timestamp that of its best, for only that can be forwarded (P3). Give it
// each answer and each firing, and none leaks: what is not forwarded is destroyed as soon as it cannot be. It has a
// place for each timestamp of its machine, which it takes to be made, so that the two cannot differ.
template <class Value, class Capacity>
class Held {
 public:
  explicit Held(const Machine<Capacity>&) noexcept {}

  // A result's value and what became of it. Gives the value to be sent downstream, if one is.
  [[nodiscard]] std::optional<Value> result(Priority source, Value value, const Answer& answer) {
    if (answer.is(FUSELINE_OUTCOME_HELD)) {
      hold(answer.timestamp(), source, std::move(value));
      return std::nullopt;
    }
    if (is_output(answer) && answer.by() == source) {
      static_cast<void>(take(answer.timestamp(), source));
      return std::optional<Value>(std::move(value));
    }
    return settled(answer);
  }

  // A failure or a firing. Gives the value to be sent downstream, if one is.
  [[nodiscard]] std::optional<Value> settled(const Answer& answer) {
    if (is_output(answer)) {
      std::optional<Value> value = take(answer.timestamp(), answer.by());
      lost_ += value ? 0U : 1U;
      return value;
    }
    if (answer.is(FUSELINE_OUTCOME_MISSED)) static_cast<void>(take(answer.timestamp(), local));
    return std::nullopt;
  }

  // How many values found no place, or were not there when they were to be sent: not 0 if an answer or a firing was not
  // given, or one of another machine was.
  std::size_t lost() const noexcept { return lost_; }

  std::size_t size() const noexcept {
    std::size_t held = 0;
    for (const Place& place : places_) held += place.value.has_value() ? 1U : 0U;
    return held;
  }

 private:
  static bool is_output(const Answer& answer) noexcept {
    return answer.is(FUSELINE_OUTCOME_FORWARDED) || answer.is(FUSELINE_OUTCOME_PRELIMINARY);
  }

  struct Place {
    Timestamp timestamp;
    Priority source;
    std::optional<Value> value;
  };

  void hold(Timestamp t, Priority source, Value&& value) {
    Place* place = find(t);
    if (place != nullptr && source < place->source) return;
    for (std::size_t i = 0; place == nullptr && i < places_.size(); ++i) {
      if (!places_[i].value.has_value()) place = &places_[i];
    }
    if (place == nullptr) {
      ++lost_;
      return;
    }
    place->timestamp = t;
    place->source = source;
    place->value.emplace(std::move(value));
  }

  // Empties the timestamp's place; gives its value if it is that of `by`.
  std::optional<Value> take(Timestamp t, Priority by) {
    std::optional<Value> value;
    if (Place* place = find(t)) {
      if (place->source == by) value = std::move(place->value);
      place->value.reset();
    }
    return value;
  }

  Place* find(Timestamp t) noexcept {
    for (Place& place : places_) {
      if (place.value.has_value() && place.timestamp == t) return &place;
    }
    return nullptr;
  }

  std::array<Place, Capacity::window> places_{};
  std::size_t lost_ = 0;
};

// What an operator's sink has to have; derive from it to leave out what you do not need.
//
// Under Commit::progressive a sink has two more, which nothing here stands in for. Without them no such operator is made:
// FUSELINE_STATUS_COMMIT.
//
//     void preliminary(Timestamp, Priority, Value);  // send it; better ones may follow, then forward or final
//     void final(Timestamp, Priority);               // what was sent last was the last
template <class Value>
struct Sink {
  // Once for each message that is forwarded, the last output under progressive: send it.
  void forward(Timestamp, Priority, Value) {}
  // Once for each message for which nothing came and nothing will.
  void miss(Timestamp) {}
  // The result of this cloud is no longer wanted: abort its call, if you like.
  void cancel(Timestamp, Priority) {}
  // Timers fired: for records. The others report what follows.
  void fired(const Firing&) {}
};

namespace detail {
// Whether a sink takes outputs before the last one.
template <class Into, class Value, class = void>
struct TakesPreliminary : std::false_type {};
template <class Into, class Value>
struct TakesPreliminary<Into, Value,
                        std::void_t<decltype(std::declval<Into&>().preliminary(Timestamp(), Priority(), std::declval<Value>())),
                                    decltype(std::declval<Into&>().final(Timestamp(), Priority()))>> : std::true_type {};
}  // namespace detail

// An operator for one thread: the machine, the values of held results, a clock and where results go.
//
// Each function reads the clock, gives what is due to the sink, and then does what its name says. Wake up at next_due()
// and tick. A message whose open is refused is the caller's to report: its sink hears nothing of it.
template <class Value, class Into, class Capacity = C3W16, class Clock = std::chrono::steady_clock>
class Operator {
  static_assert(Clock::is_steady, "Fuseline takes a steady clock: others are set back and forth");
  static_assert(!std::chrono::treat_as_floating_point_v<typename Clock::rep>,
                "Fuseline takes a clock that counts in whole numbers: a due instant must not be rounded down");

 public:
  Operator(Into& sink, std::uint32_t window, Commit commit, Deadline greatest_deadline,
           std::initializer_list<Cloud> clouds)
      : sink_(sink), machine_(window, taken(commit), greatest_deadline, clouds) {}
  Operator(Into& sink, std::uint32_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds,
           std::size_t size)
      : sink_(sink), machine_(window, taken(commit), greatest_deadline, clouds, size) {}

  Status status() const noexcept { return machine_.status(); }
  explicit operator bool() const noexcept { return static_cast<bool>(machine_); }

  // A message came: compute on board, and offer it to the clouds, unless it is refused.
  [[nodiscard]] std::optional<Answer> open(Timestamp t, std::optional<Deadline> limit = std::nullopt) {
    return machine_.open(now(), t, limit, fired());
  }

  // Send it to this cloud if it is admitted.
  [[nodiscard]] std::optional<Answer> offer(Timestamp t, Priority cloud, Deadline deadline, std::uint64_t backlog) {
    return machine_.offer(now(), t, cloud, deadline, backlog, fired());
  }

  // A source's result came with this value.
  std::optional<Answer> result(Timestamp t, Priority source, Value value) {
    const std::optional<Answer> answer = machine_.result(now(), t, source, fired());
    if (answer) conclude(*answer, held_.result(source, std::move(value), *answer));
    return answer;
  }

  // No result will come from this source.
  std::optional<Answer> fail(Timestamp t, Priority source) {
    const std::optional<Answer> answer = machine_.fail(now(), t, source, fired());
    if (answer) conclude(*answer, held_.settled(*answer));
    return answer;
  }

  // Time went by. False if the machine could not be asked.
  bool tick() { return machine_.tick(now(), fired()).has_value(); }

  // When to tick next. Nothing if no timer is armed, or if status() is not FUSELINE_STATUS_DONE.
  [[nodiscard]] std::optional<typename Clock::time_point> next_due() noexcept {
    const std::optional<Instant> due = machine_.next_due();
    if (!due) return std::nullopt;
    using Rest = typename Clock::duration;
    using Reading = typename Clock::time_point;
    const Rest room = start_ < Reading() ? Reading::max().time_since_epoch() : Reading::max() - start_;
    if (due->ns() >= nanoseconds_of(room)) return Reading::max();
    // Rounded up: a tick before the due instant fires nothing.
    const Rest rest = std::chrono::duration_cast<Rest>(detail::Nanoseconds(due->ns()));
    return start_ + (nanoseconds_of(rest) < due->ns() ? rest + Rest(1) : rest);
  }

  // How many values are held.
  std::size_t held() const noexcept { return held_.size(); }

 private:
  static constexpr bool takes_preliminary = detail::TakesPreliminary<Into, Value>::value;

  // The commit rule, or one that no machine has if the sink does not take its outputs.
  static constexpr Commit taken(Commit commit) noexcept {
    return commit != Commit::progressive || takes_preliminary ? commit : static_cast<Commit>(UINT32_MAX);
  }

  Instant now() const {
    const typename Clock::time_point reading = Clock::now();
    return reading < start_ ? Instant() : Instant(reading - start_);
  }

  auto fired() {
    return [this](const Firing& firing) {
      sink_.fired(firing);
      conclude(firing, held_.settled(firing));
    };
  }

  void conclude(const Answer& answer, std::optional<Value> value) {
    const Timestamp t = answer.timestamp();
    if (answer.is(FUSELINE_OUTCOME_MISSED)) sink_.miss(t);
    if (answer.is(FUSELINE_OUTCOME_FORWARDED)) {
      if (!value) return sink_.miss(t);  // cannot be; if it were, the message would not end in silence
      sink_.forward(t, answer.by(), std::move(*value));
    }
    if constexpr (takes_preliminary) {
      if (answer.is(FUSELINE_OUTCOME_PRELIMINARY) && value) sink_.preliminary(t, answer.by(), std::move(*value));
      if (answer.is(FUSELINE_OUTCOME_FINAL)) sink_.final(t, answer.by());
    }
    for (const Priority cloud : answer.cancelled()) sink_.cancel(t, cloud);
  }

  Into& sink_;
  typename Clock::time_point start_ = Clock::now();
  Machine<Capacity> machine_;
  Held<Value, Capacity> held_{machine_};
};

}  // namespace fuseline

#endif  // FUSELINE_HPP
