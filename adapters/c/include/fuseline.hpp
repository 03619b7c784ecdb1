// Fuseline for C++17, header only, over fuseline.h: no exceptions, no RTTI, no allocation.
//
//   Machine<Capacity>   the machine: answers, as in C, with the types of C++
//   Held<Value, N>      the values of held results, move-only ones too
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
#include <utility>

namespace fuseline {

// Nanoseconds, as the machine counts them: all of 64 bits. Any std::chrono duration that is not negative converts.
using Duration = std::chrono::duration<std::uint64_t, std::nano>;

// The machine's clock: a reading of yours, counted from any fixed start.
struct Monotonic {};
using Instant = std::chrono::time_point<Monotonic, Duration>;

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

enum class Commit : std::uint32_t { eager = FUSELINE_COMMIT_EAGER, patient = FUSELINE_COMMIT_PATIENT };
using Status = fuseline_status;
using Outcome = fuseline_outcome;
using Reason = fuseline_reason;

// How much a machine has room for, and the storage for it.
template <std::uint32_t Id, std::size_t Clouds, std::size_t Window>
struct Capacity {
  static constexpr std::uint32_t id = Id;
  static constexpr std::size_t window = Window;
  using Storage = std::array<std::uint64_t, FUSELINE_STORAGE_BYTES(Clouds, Window) / 8U>;
};
using C1W4 = Capacity<FUSELINE_CAPACITY_C1W4, 1, 4>;
using C3W16 = Capacity<FUSELINE_CAPACITY_C3W16, 3, 16>;
using C7W64 = Capacity<FUSELINE_CAPACITY_C7W64, 7, 64>;
using C15W1024 = Capacity<FUSELINE_CAPACITY_C15W1024, 15, 1024>;
// What the library was built for by FUSELINE_OWN_CLOUDS and FUSELINE_OWN_WINDOW.
template <std::size_t Clouds, std::size_t Window>
using Own = Capacity<FUSELINE_CAPACITY_OWN, Clouds, Window>;

// One cloud as configured: its gate shuts at `limit` queued requests and opens at `resume`, limit - 1 unless given.
struct Cloud {
  Priority priority;
  std::uint64_t limit = 1;
  std::optional<std::uint64_t> resume = std::nullopt;
};

// Some priorities, ascending.
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
  constexpr Priorities(const std::uint16_t* first, std::uint32_t size) noexcept : first_(first), size_(size) {}
  constexpr iterator begin() const noexcept { return iterator(first_); }
  constexpr iterator end() const noexcept { return iterator(first_ + size_); }
  constexpr std::size_t size() const noexcept { return size_; }

 private:
  const std::uint16_t* first_;
  std::uint32_t size_;
};

// What became of an input.
class Answer {
 public:
  explicit Answer(const fuseline_answer& plain) noexcept : plain_(plain) {}
  Instant at() const noexcept { return Instant(Duration(plain_.at)); }
  Timestamp timestamp() const noexcept { return Timestamp{plain_.t}; }
  Outcome outcome() const noexcept { return plain_.outcome; }
  bool is(Outcome outcome) const noexcept { return plain_.outcome == outcome; }
  // Why it was refused or dropped; FUSELINE_REASON_NONE if it was neither.
  Reason why() const noexcept { return plain_.why; }
  // Whose result is forwarded.
  Priority by() const noexcept { return Priority{plain_.by}; }
  // An admitted request's, or that of the timers that fired.
  Instant due() const noexcept { return Instant(Duration(plain_.due)); }
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
// of itself, or nothing if status() says that the machine could not be asked.
template <class Capacity = C3W16>
class Machine {
 public:
  Machine(std::uint32_t window, Commit commit, std::initializer_list<Cloud> clouds) noexcept
      : Machine(window, commit, clouds.begin(), clouds.size()) {}

  Machine(std::uint32_t window, Commit commit, const Cloud* clouds, std::size_t size) noexcept {
    std::array<fuseline_cloud, FUSELINE_SOURCES> plain{};
    if (size > plain.size()) {
      status_ = FUSELINE_STATUS_CLOUDS;
      return;
    }
    for (std::size_t i = 0; i < size; ++i) {
      const Cloud& cloud = clouds[i];
      plain[i] = {cloud.priority.number, cloud.limit, cloud.resume.value_or(cloud.limit > 0 ? cloud.limit - 1 : 0)};
    }
    const fuseline_config config{
        FUSELINE_CONFIG, Capacity::id, static_cast<std::uint32_t>(commit), window, static_cast<std::uint32_t>(size),
        plain.data()};
    status_ = fuseline_init(storage_.data(), sizeof storage_, &config, &machine_);
  }

  ~Machine() {
    if (machine_ != nullptr) static_cast<void>(fuseline_end(machine_));
  }
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;

  // FUSELINE_STATUS_DONE, or why the last call to the machine, its making too, was in vain.
  Status status() const noexcept { return status_; }
  explicit operator bool() const noexcept { return machine_ != nullptr; }

  // F1: a message came. `limit` is how long local may take for it.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> open(Instant now, Timestamp t, std::optional<Duration> limit, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return limit ? fuseline_open_within(machine_, ns(now), t.count, limit->count(), answer)
                   : fuseline_open(machine_, ns(now), t.count, answer);
    });
  }

  // F2: may it be sent to this cloud, in whose queue `backlog` others wait?
  template <class Fired>
  [[nodiscard]] std::optional<Answer> offer(Instant now, Timestamp t, Priority cloud, Duration deadline,
                                            std::uint64_t backlog, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_offer(machine_, ns(now), t.count, cloud.number, deadline.count(), backlog, answer);
    });
  }

  // F3: the source's result came.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> result(Instant now, Timestamp t, Priority source, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_result(machine_, ns(now), t.count, source.number, answer);
    });
  }

  // F4: no result will come from the source.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> fail(Instant now, Timestamp t, Priority source, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_fail(machine_, ns(now), t.count, source.number, answer);
    });
  }

  // F0: time went by.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> tick(Instant now, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) { return fuseline_tick(machine_, ns(now), answer); });
  }

  // When a timer is due next; tick then.
  [[nodiscard]] std::optional<Instant> next_due() noexcept {
    std::uint64_t due = 0;
    if (fuseline_next_due(machine_, &due) != FUSELINE_STATUS_DONE) return std::nullopt;
    return Instant(Duration(due));
  }

  // What the machine knows of itself.
  [[nodiscard]] std::optional<fuseline_state> look() noexcept {
    fuseline_state state{};
    if (fuseline_look(machine_, &state) != FUSELINE_STATUS_DONE) return std::nullopt;
    return state;
  }

 private:
  static std::uint64_t ns(Instant instant) noexcept { return instant.time_since_epoch().count(); }

  template <class Fired, class Call>
  std::optional<Answer> ask(Fired& fired, Call call) {
    fuseline_answer answer{};
    while ((status_ = call(&answer)) == FUSELINE_STATUS_AGAIN) {
      const Firing firing(answer);
      fired(firing);
    }
    if (status_ != FUSELINE_STATUS_DONE) return std::nullopt;
    return Answer(answer);
  }

  alignas(8) typename Capacity::Storage storage_{};
  fuseline_machine* machine_ = nullptr;
  Status status_ = FUSELINE_STATUS_NULL;
};

// The values of held results: of each open timestamp that of its best, for only that can be forwarded (P3). Tell it
// each answer and each firing, and none leaks: what is not forwarded is destroyed as soon as it cannot be.
template <class Value, std::size_t Window>
class Held {
 public:
  // A result's value and what became of it. Gives the value to be sent downstream, if one is.
  [[nodiscard]] std::optional<Value> result(Priority source, Value value, const Answer& answer) {
    if (answer.is(FUSELINE_OUTCOME_HELD)) {
      hold(answer.timestamp(), source, std::move(value));
      return std::nullopt;
    }
    if (answer.is(FUSELINE_OUTCOME_FORWARDED) && answer.by() == source) {
      static_cast<void>(take(answer.timestamp(), source));
      return std::optional<Value>(std::move(value));
    }
    return settled(answer);
  }

  // A failure or a firing. Gives the value to be sent downstream, if one is.
  [[nodiscard]] std::optional<Value> settled(const Answer& answer) {
    if (answer.is(FUSELINE_OUTCOME_FORWARDED)) return take(answer.timestamp(), answer.by());
    if (answer.is(FUSELINE_OUTCOME_MISSED)) static_cast<void>(take(answer.timestamp(), local));
    return std::nullopt;
  }

  std::size_t size() const noexcept {
    std::size_t held = 0;
    for (const Place& place : places_) held += place.value.has_value() ? 1U : 0U;
    return held;
  }

 private:
  struct Place {
    Timestamp timestamp;
    Priority source;
    std::optional<Value> value;
  };

  void hold(Timestamp t, Priority source, Value&& value) {
    Place* place = find(t);
    if (place != nullptr && source < place->source) return;
    for (std::size_t i = 0; place == nullptr && i < Window; ++i) {
      if (!places_[i].value.has_value()) place = &places_[i];
    }
    if (place == nullptr) return;  // cannot be: as many places as open timestamps
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

  std::array<Place, Window> places_{};
};

// What an operator's sink has to have; derive from it to leave out what you do not need.
template <class Value>
struct Sink {
  // Once for each message that is forwarded: send it.
  void forward(Timestamp, Priority, Value) {}
  // Once for each message for which nothing came and nothing will.
  void miss(Timestamp) {}
  // The result of this cloud is no longer wanted: abort its call, if you like.
  void cancel(Timestamp, Priority) {}
  // Timers fired: for records. What follows is told by the others.
  void fired(const Firing&) {}
};

// An operator for one thread: the machine, the values of held results, a clock and where results go.
//
// Each function reads the clock, gives what is due to the sink, and then does what its name says. Wake up at next_due()
// and tick. A message whose open is refused is the caller's to report: its sink hears nothing of it.
template <class Value, class Into, class Capacity = C3W16, class Clock = std::chrono::steady_clock>
class Operator {
 public:
  Operator(Into& sink, std::uint32_t window, Commit commit, std::initializer_list<Cloud> clouds)
      : sink_(sink), machine_(window, commit, clouds) {}
  Operator(Into& sink, std::uint32_t window, Commit commit, const Cloud* clouds, std::size_t size)
      : sink_(sink), machine_(window, commit, clouds, size) {}

  Status status() const noexcept { return machine_.status(); }
  explicit operator bool() const noexcept { return static_cast<bool>(machine_); }

  // A message came: compute on board, and offer it to the clouds, unless it is refused.
  [[nodiscard]] std::optional<Answer> open(Timestamp t, std::optional<Duration> limit = std::nullopt) {
    return machine_.open(now(), t, limit, fired());
  }

  // Send it to this cloud if it is admitted.
  [[nodiscard]] std::optional<Answer> offer(Timestamp t, Priority cloud, Duration deadline, std::uint64_t backlog) {
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

  // When to tick next.
  [[nodiscard]] std::optional<typename Clock::time_point> next_due() noexcept {
    const std::optional<Instant> due = machine_.next_due();
    if (!due) return std::nullopt;
    using Rest = typename Clock::duration;
    const Duration most = std::chrono::duration_cast<Duration>(Clock::time_point::max() - start_);
    const Duration after = due->time_since_epoch();
    if (after >= most) return Clock::time_point::max();
    // Rounded up: a tick before the due instant fires nothing.
    const Rest rest = std::chrono::duration_cast<Rest>(after);
    return start_ + (std::chrono::duration_cast<Duration>(rest) < after ? rest + Rest(1) : rest);
  }

  // How many values are held.
  std::size_t held() const noexcept { return held_.size(); }

 private:
  Instant now() const {
    const auto since = Clock::now() - start_;
    return since < since.zero() ? Instant() : Instant(std::chrono::duration_cast<Duration>(since));
  }

  auto fired() {
    return [this](const Firing& firing) {
      sink_.fired(firing);
      conclude(firing, held_.settled(firing));
    };
  }

  void conclude(const Answer& answer, std::optional<Value> value) {
    if (answer.is(FUSELINE_OUTCOME_MISSED)) sink_.miss(answer.timestamp());
    if (!answer.is(FUSELINE_OUTCOME_FORWARDED) || !value) return;
    sink_.forward(answer.timestamp(), answer.by(), std::move(*value));
    for (const Priority cloud : answer.cancelled()) sink_.cancel(answer.timestamp(), cloud);
  }

  Into& sink_;
  typename Clock::time_point start_ = Clock::now();
  Machine<Capacity> machine_;
  Held<Value, Capacity::window> held_;
};

}  // namespace fuseline

#endif  // FUSELINE_HPP
