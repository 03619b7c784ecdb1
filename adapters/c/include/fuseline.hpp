// Fuseline for C++17, header only, over fuseline.h: it needs no exceptions, no RTTI and no allocation.
//
//   Machine<Capacity>   the machine: answers, as in C, with the types of C++
//   Held<Value, C>      the values of held results, move-only ones too
//   Operator<...>       both with a clock and a sink: an operator for one thread
//
// Exceptions: this header throws none of its own. A sink, a function `fired`, a clock and the move of a value may throw.
// Machine, Held and Operator say what happens then. Destructors must not throw. The destructor of a value may call the
// operator that held it.
//
// SPEC.md has the rules (F), promises (P) and ambiguities (A) that are named here.

#ifndef FUSELINE_HPP
#define FUSELINE_HPP

#include "fuseline.h"

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
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
template <class Value>
inline constexpr bool is_value = std::is_object_v<Value> && !std::is_const_v<Value> && std::is_move_constructible_v<Value> &&
                                 std::is_move_assignable_v<Value>;
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

// A reading of your monotonic clock, in nanoseconds from any fixed start. A reading before the start is 0, one that is too
// late is the last. A difference has its sign: it is std::chrono::nanoseconds, and saturates.
class Instant {
 public:
  constexpr Instant() noexcept = default;
  template <class Clock, class Elapsed>
  explicit constexpr Instant(const std::chrono::time_point<Clock, Elapsed>& reading) noexcept
      : ns_(nanoseconds_of(reading.time_since_epoch())) {
    static_assert(Clock::is_steady, "Fuseline takes a steady clock: others are set back and forth");
  }
  // A reading of a clock that std::chrono does not have, since its start. Nothing checks that this clock is monotonic: you
  // vouch for it. The time of day is not, and neither is a counter of ticks that wraps.
  template <class Rep, class Period>
  [[nodiscard]] static constexpr Instant from_monotonic(const std::chrono::duration<Rep, Period>& since_start) noexcept {
    Instant reading;
    reading.ns_ = nanoseconds_of(since_start);
    return reading;
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
// this window refuses to make the machine, FUSELINE_STATUS_CAPACITY. fuseline_capacity.hpp has one that is chosen at run time.
template <std::size_t Clouds, std::size_t Window>
struct Capacity {
  static_assert(Clouds < FUSELINE_SOURCES, "a machine has at most 15 clouds");
  static_assert(Window >= 1 && Window <= 1024, "a machine has a window of 1 to 1024");
  static constexpr std::uint32_t id = FUSELINE_CAPACITY_OF(Clouds, Window);

  // The storage of a machine, within the machine itself.
  class Storage {
   public:
    Storage(std::size_t, std::size_t) noexcept {}
    static constexpr std::uint32_t capacity() noexcept { return id; }
    static constexpr std::size_t window() noexcept { return Window; }
    static constexpr std::size_t bytes() noexcept { return sizeof(words_); }
    void* data() noexcept { return words_.data(); }

   private:
    alignas(8) std::array<std::uint64_t, FUSELINE_STORAGE_BYTES(Clouds, Window) / 8U> words_{};
  };
  // A place for each timestamp that may be open.
  template <class Place>
  struct Places : std::array<Place, Window> {
    explicit Places(std::size_t) : std::array<Place, Window>() {}
  };
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
  Instant at() const noexcept { return Instant::from_monotonic(detail::Nanoseconds(plain_.at)); }
  Timestamp timestamp() const noexcept { return Timestamp{plain_.t}; }
  Outcome outcome() const noexcept { return plain_.outcome; }
  bool is(Outcome outcome) const noexcept { return plain_.outcome == outcome; }
  // Why it was refused or dropped; FUSELINE_REASON_NONE if it was neither.
  Reason why() const noexcept { return plain_.why; }
  // Whose result is forwarded, preliminary or final.
  Priority by() const noexcept { return Priority{plain_.by}; }
  // An admitted request's, or that of the timers that fired.
  Instant due() const noexcept { return Instant::from_monotonic(detail::Nanoseconds(plain_.due)); }
  // The clouds whose results are no longer wanted.
  Priorities cancelled() const noexcept { return {plain_.cancelled, plain_.cancelled_len}; }

 protected:
  fuseline_answer plain_;
};

// The answer to an open or an offer. True if the message is accepted or the request admitted: what is refused must not be
// computed or sent. Whether there is an answer at all, has_value() says.
class Decision : public std::optional<Answer> {
 public:
  using std::optional<Answer>::optional;
  explicit Decision(std::optional<Answer>&& answer) noexcept : std::optional<Answer>(std::move(answer)) {}
  explicit operator bool() const noexcept {
    return has_value() && ((*this)->is(FUSELINE_OUTCOME_ACCEPTED) || (*this)->is(FUSELINE_OUTCOME_ADMITTED));
  }
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
//
// If `fired` throws, its firing has happened and the input has not: keep what you have of the firing, and call again.
template <class Capacity = C3W16>
class Machine {
  static constexpr bool is_noexcept = std::is_nothrow_constructible_v<typename Capacity::Storage, std::size_t, std::size_t>;

 public:
  Machine(std::size_t window, Commit commit, Deadline greatest_deadline,
          std::initializer_list<Cloud> clouds) noexcept(is_noexcept)
      : Machine(window, commit, greatest_deadline, clouds.begin(), clouds.size()) {}

  Machine(std::size_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds,
          std::size_t size) noexcept(is_noexcept)
      : storage_(size, window) {
    std::array<fuseline_cloud, FUSELINE_SOURCES> plain{};
    if (size > plain.size()) {
      status_ = FUSELINE_STATUS_CLOUDS;
      return;
    }
    if (clouds == nullptr && size > 0) return;  // FUSELINE_STATUS_NULL
    // A window that does not fit 32 bits is above every capacity, as the greatest of 32 bits is.
    constexpr std::size_t greatest = std::numeric_limits<std::uint32_t>::max();
    for (std::size_t i = 0; i < size; ++i) {
      const Cloud& cloud = clouds[i];
      plain[i] = {cloud.priority.number, cloud.limit, cloud.resume.value_or(cloud.limit > 0 ? cloud.limit - 1 : 0)};
    }
    const fuseline_config config{FUSELINE_CONFIG,
                                 storage_.capacity(),
                                 static_cast<std::uint32_t>(commit),
                                 static_cast<std::uint32_t>(window < greatest ? window : greatest),
                                 static_cast<std::uint32_t>(size),
                                 plain.data(),
                                 greatest_deadline.ns()};
    status_ = fuseline_init(storage_.data(), storage_.bytes(), &config, &machine_);
  }

  ~Machine() { end(); }
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;

  // FUSELINE_STATUS_DONE, or why the last call to the machine was in vain; if it could not be made, why not, for ever.
  Status status() const noexcept { return status_; }
  explicit operator bool() const noexcept { return machine_ != nullptr; }

  // The most messages that its capacity lets be open.
  std::size_t greatest_window() const noexcept { return storage_.window(); }

  // F1: a message came. `limit` is how long local may take for it.
  template <class Fired>
  [[nodiscard]] Decision open(Instant now, Timestamp t, std::optional<Deadline> limit, Fired&& fired) {
    return Decision(ask(fired, [&](fuseline_answer* answer) {
      return limit ? fuseline_open_within(machine_, now.ns(), t.count, limit->ns(), answer)
                   : fuseline_open(machine_, now.ns(), t.count, answer);
    }));
  }

  // F2: may it be sent to this cloud, in whose queue `backlog` others wait?
  template <class Fired>
  [[nodiscard]] Decision offer(Instant now, Timestamp t, Priority cloud, Deadline deadline, std::uint64_t backlog,
                               Fired&& fired) {
    return Decision(ask(fired, [&](fuseline_answer* answer) {
      return fuseline_offer(machine_, now.ns(), t.count, cloud.number, deadline.ns(), backlog, answer);
    }));
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
    return Instant::from_monotonic(detail::Nanoseconds(due));
  }

  // Ends the machine: no later call has an answer, FUSELINE_STATUS_FOREIGN.
  void end() noexcept {
    if (machine_ == nullptr) return;
    static_cast<void>(fuseline_end(machine_));
    machine_ = nullptr;
    status_ = FUSELINE_STATUS_FOREIGN;
  }

  // What the machine knows of an open message. Nothing if it is not open, or if status() is not FUSELINE_STATUS_DONE.
  [[nodiscard]] std::optional<fuseline_message> look_at(Timestamp t) noexcept {
    fuseline_message message{};
    if (!answered([&] { return fuseline_look_at(machine_, t.count, &message); })) return std::nullopt;
    return message;
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

  typename Capacity::Storage storage_;
  fuseline_machine* machine_ = nullptr;
  Status status_ = FUSELINE_STATUS_NULL;
};

// The values of held results: of each open timestamp that of its best, for only that can be forwarded (P3). Give it
// each answer and each firing, and none leaks: what is not forwarded is destroyed as soon as it cannot be. It has a
// place for each timestamp of its machine, which it takes to be made, so that the two cannot differ.
//
// A value is destroyed when all others are in their places, so its destructor may call whoever calls this. If the move of
// a value throws, that value alone is lost, and lost() counts it when it was to be sent.
template <class Value, class Capacity>
class Held {
  static_assert(detail::is_value<Value>, "a value is an object that can be moved: neither const, nor a reference, an array or void");

 public:
  explicit Held(const Machine<Capacity>& machine) : places_(machine.greatest_window()) {}

  // A result's value and what became of it. Gives the value to be sent downstream, if one is.
  [[nodiscard]] std::optional<Value> result(Priority source, Value value, const Answer& answer) {
    if (answer.is(FUSELINE_OUTCOME_HELD)) {
      hold(answer.timestamp(), source, std::move(value));
      return std::nullopt;
    }
    if (is_output(answer) && answer.by() == source) {
      discard(answer.timestamp());
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
    if (answer.is(FUSELINE_OUTCOME_MISSED)) discard(answer.timestamp());
    return std::nullopt;
  }

  // How many values found no place, or were not there when they were to be sent: not 0 if an answer or a firing was not
  // given, one of another machine was, or the move of a value threw.
  std::size_t lost() const noexcept { return lost_; }

  std::size_t size() const noexcept {
    std::size_t held = 0;
    for (const Place& place : places_) held += place.use == Use::held ? 1U : 0U;
    return held;
  }

 private:
  static bool is_output(const Answer& answer) noexcept {
    return answer.is(FUSELINE_OUTCOME_FORWARDED) || answer.is(FUSELINE_OUTCOME_PRELIMINARY);
  }

  // A place that is emptied is nobody's: the destructor of what was in it may call.
  enum class Use : unsigned char { free, held, emptied };
  struct Place {
    Timestamp timestamp;
    Priority source;
    std::optional<Value> value;
    Use use = Use::free;
  };
  class Emptying {
   public:
    explicit Emptying(Place& place) noexcept : place_(place) { place_.use = Use::emptied; }
    ~Emptying() {
      place_.value.reset();
      place_.use = Use::free;
    }
    Emptying(const Emptying&) = delete;
    Emptying& operator=(const Emptying&) = delete;

   private:
    Place& place_;
  };
  static constexpr Priority no_source{std::numeric_limits<std::uint64_t>::max()};

  void hold(Timestamp t, Priority source, Value&& value) {
    Place* place = find(t);
    if (place != nullptr) return replace(*place, source, std::move(value));
    for (std::size_t i = 0; place == nullptr && i < places_.size(); ++i) {
      if (places_[i].use == Use::free) place = &places_[i];
    }
    if (place == nullptr) {
      ++lost_;
      return;
    }
    place->value.emplace(std::move(value));
    place->timestamp = t;
    place->source = source;
    place->use = Use::held;
  }

  // The outdone value is destroyed last, when the better one is in its place.
  void replace(Place& place, Priority source, Value&& value) {
    if (source < place.source && place.source != no_source) return;
    [[maybe_unused]] const Value outdone(std::move(*place.value));
    place.source = no_source;  // stays if the next line throws: then nothing is held here that could be sent
    *place.value = std::move(value);
    place.source = source;
  }

  // Empties the timestamp's place; gives its value if it is that of `by`.
  std::optional<Value> take(Timestamp t, Priority by) {
    std::optional<Value> value;
    Place* place = find(t);
    if (place == nullptr) return value;
    if (place->source != by) {
      discard(t);
      return value;
    }
    const Emptying emptying(*place);
    value.emplace(std::move(*place->value));
    return value;
  }

  // Empties the timestamp's place. Its value is destroyed when the place is free again, if the move cannot throw.
  void discard(Timestamp t) noexcept {
    std::optional<Value> outdone;
    if (Place* place = find(t)) {
      const Emptying emptying(*place);
      if constexpr (std::is_nothrow_move_constructible_v<Value>) outdone.emplace(std::move(*place->value));
    }
  }

  Place* find(Timestamp t) noexcept {
    for (Place& place : places_) {
      if (place.use == Use::held && place.timestamp == t) return &place;
    }
    return nullptr;
  }

  typename Capacity::template Places<Place> places_;
  std::size_t lost_ = 0;
};

// What an operator's sink may leave out: derive from it. Two members it must have, or its operator does not compile:
//
//     void forward(Timestamp, Priority, Value);  // once for each message that is forwarded, the last output under progressive: send it
//     void miss(Timestamp);                      // once for each message for which nothing came and nothing will
//
// Name the sink's own type in the operator: nothing here is virtual. A base of the sink is refused unless it has virtual
// functions or, if the operator only ever saw the base, unless the base has the two members itself.
//
// Under Commit::progressive a sink has two more, which nothing here stands in for. Without them no such operator is made:
// FUSELINE_STATUS_COMMIT.
//
//     void preliminary(Timestamp, Priority, Value);  // send it; better ones may follow, then forward or final
//     void final(Timestamp, Priority);               // what was sent last was the last
template <class Value>
struct Sink {
  // The result of this cloud is no longer wanted: abort its call, if you like.
  void cancel(Timestamp, Priority) {}
  // Timers fired: for records. The others report what follows.
  void fired(const Firing&) {}
};

namespace detail {
// Whether a sink takes outputs.
template <class Into, class Value, class = void>
struct TakesOutputs : std::false_type {};
template <class Into, class Value>
struct TakesOutputs<Into, Value,
                    std::void_t<decltype(std::declval<Into&>().forward(Timestamp(), Priority(), std::declval<Value>())),
                                decltype(std::declval<Into&>().miss(Timestamp()))>> : std::true_type {};

// Whether a sink takes outputs before the last one.
template <class Into, class Value, class = void>
struct TakesPreliminary : std::false_type {};
template <class Into, class Value>
struct TakesPreliminary<Into, Value,
                        std::void_t<decltype(std::declval<Into&>().preliminary(Timestamp(), Priority(), std::declval<Value>())),
                                    decltype(std::declval<Into&>().final(Timestamp(), Priority()))>> : std::true_type {};
}  // namespace detail

namespace detail {
// Whether a clock is an object, which an operator is given: the standard library's have a static now().
template <class Clock, class = void>
struct IsObject : std::true_type {};
template <class Clock>
struct IsObject<Clock, std::void_t<decltype(Clock::now())>> : std::false_type {};
}  // namespace detail

// What an operator could not deliver.
struct SinkFailures {
  std::size_t len = 0;  // calls of the sink that threw, moves of values that threw, and outputs without a value after that
  Timestamp last;       // the message of the last of them, if there is one
};

// An operator for one thread: the machine, the values of held results, a clock and where results go.
//
// Each function reads the clock, gives what is due to the sink, and then does what its name says. Wake up at next_due()
// and tick. A message whose open is refused is the caller's to report: its sink hears nothing of it.
//
// What a sink throws stops nothing: all that was due and the input itself are done, and the sink's other functions are
// called. The first exception since then is thrown at the end of result, fail or tick, by the outermost call if a sink or
// a destructor called within another. Open and offer do not throw it, for their answer would be lost: the next result,
// fail or tick does. sink_failures() counts each at once. A clock that throws is asked before anything is done, but the
// value that result was given is gone.
//
// Its end ends its machine first: what a destructor of a held value reports then is refused, FUSELINE_STATUS_FOREIGN. An
// operator that is destroyed within a call of its own, as by its sink, ends the program: std::terminate.
//
// `Clock` is a type of steady clock. One whose now() is not static is an object: give it after the clouds, and let it live
// longer than the operator. fuseline_clock.hpp has two.
//
// `Using` is the machine: fuseline_record.hpp has one that records.
template <class Value, class Into, class Capacity = C3W16, class Clock = std::chrono::steady_clock,
          template <class> class Using = Machine>
class Operator {
  static_assert(Clock::is_steady, "Fuseline takes a steady clock: others are set back and forth");
  static_assert(!std::chrono::treat_as_floating_point_v<typename Clock::rep>,
                "Fuseline takes a clock that counts in whole numbers: a due instant must not be rounded down");
  static_assert(sizeof(typename Clock::rep) >= sizeof(std::int64_t),
                "Fuseline takes a clock that counts in 64 bits: fewer wrap, after 49 days of milliseconds in 32");

 public:
  template <class Given>
  Operator(Given& sink, std::size_t window, Commit commit, Deadline greatest_deadline,
           std::initializer_list<Cloud> clouds)
      : Operator(sink, window, commit, greatest_deadline, clouds.begin(), clouds.size()) {}
  template <class Given>
  Operator(Given& sink, std::size_t window, Commit commit, Deadline greatest_deadline,
           std::initializer_list<Cloud> clouds, Clock& clock)
      : Operator(sink, window, commit, greatest_deadline, clouds.begin(), clouds.size(), clock) {}
  template <class Given>
  Operator(Given& sink, std::size_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds,
           std::size_t size)
      : Operator(&sink, window, commit, greatest_deadline, clouds, size, nullptr) {
    static_assert(!detail::IsObject<Clock>::value, "this clock is an object: give it to the operator, after the clouds");
  }
  template <class Given>
  Operator(Given& sink, std::size_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds,
           std::size_t size, Clock& clock)
      : Operator(&sink, window, commit, greatest_deadline, clouds, size, &clock) {}
  ~Operator() {
    // Its own sink, or the destructor of a value, would go on with what is no longer there.
    if (calls_ > 0) std::terminate();
    machine_.end();
  }

  Status status() const noexcept { return machine_.status(); }
  explicit operator bool() const noexcept { return static_cast<bool>(machine_); }

  // A message came: compute on board, and offer it to the clouds, unless it is refused.
  [[nodiscard]] Decision open(Timestamp t, std::optional<Deadline> limit = std::nullopt) {
    const Call call(calls_);
    const Decision answer = machine_.open(now(), t, limit, fired());
    if (answer && open_len_ < open_.size()) open_[open_len_++] = t;
    return answer;
  }

  // Send it to this cloud if it is admitted.
  [[nodiscard]] Decision offer(Timestamp t, Priority cloud, Deadline deadline, std::uint64_t backlog) {
    const Call call(calls_);
    return machine_.offer(now(), t, cloud, deadline, backlog, fired());
  }

  // A source's result came with this value.
  std::optional<Answer> result(Timestamp t, Priority source, Value value) {
    return concluded([&] { return machine_.result(now(), t, source, fired()); },
                     [&](const Answer& answer) {
                       conclude(answer, [&] { return held_.result(source, std::move(value), answer); });
                     });
  }

  // No result will come from this source.
  std::optional<Answer> fail(Timestamp t, Priority source) {
    return concluded([&] { return machine_.fail(now(), t, source, fired()); },
                     [&](const Answer& answer) { conclude(answer, [&] { return held_.settled(answer); }); });
  }

  // Time went by. False if the machine could not be asked.
  bool tick() {
    return concluded([&] { return machine_.tick(now(), fired()); }, [](const Answer&) {}).has_value();
  }

  // Ends the messages that are open, the oldest first: all that is pending fails, so each is forwarded by the best result
  // that is there, or missed. The operator can be used on. False if the machine could not be asked.
  bool drain() {
    return concluded(
               [&] {
                 // A copy: what a sink opens meanwhile stays open.
                 const auto opened = open_;
                 const std::size_t len = open_len_;
                 for (std::size_t i = 0; i < len; ++i) end(opened[i]);
                 return machine_.tick(now(), fired());
               },
               [](const Answer&) {})
        .has_value();
  }

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

  // Begins the trace, before the first message. For a machine that records, by fuseline_record.hpp.
  template <class Write>
  [[nodiscard]] bool record(Write write) {
    return machine_.record(std::move(write));
  }
  bool is_recording() const noexcept { return machine_.is_recording(); }

  // What could not be delivered because the sink, or the move of a value, threw.
  SinkFailures sink_failures() const noexcept { return failures_; }

 private:
  template <class Given>
  Operator(Given* sink, std::size_t window, Commit commit, Deadline greatest_deadline, const Cloud* clouds,
           std::size_t size, Clock* clock)
      : sink_(*sink), clock_(clock), machine_(window, taken(commit), greatest_deadline, clouds, size) {
    static_assert(std::is_same_v<Given, Into> || std::is_polymorphic_v<Into>,
                  "name the sink's own type as the operator's: by a base without virtual functions its outputs would be lost");
  }

  // A call that is under way.
  class Call {
   public:
    explicit Call(unsigned& calls) noexcept : calls_(calls) { ++calls_; }
    ~Call() { --calls_; }
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;

   private:
    unsigned& calls_;
  };

  static constexpr bool takes_preliminary = detail::TakesPreliminary<Into, Value>::value;

  // The commit rule, or one that no machine has if the sink does not take its outputs.
  static constexpr Commit taken(Commit commit) noexcept {
    static_assert(detail::TakesOutputs<Into, Value>::value,
                  "the sink lacks forward(Timestamp, Priority, Value) or miss(Timestamp): is a name misspelt, or is this a base of the sink?");
    return commit != Commit::progressive || takes_preliminary ? commit : static_cast<Commit>(UINT32_MAX);
  }

  typename Clock::time_point read() const {
    if constexpr (detail::IsObject<Clock>::value) {
      return clock_->now();
    } else {
      return Clock::now();
    }
  }

  Instant now() const {
    const typename Clock::time_point reading = read();
    return reading < start_ ? Instant() : Instant::from_monotonic(reading - start_);
  }

  auto fired() {
    return [this](const Firing& firing) {
      attempt(firing.timestamp(), [&] { sink_.fired(firing); });
      conclude(firing, [&] { return held_.settled(firing); });
    };
  }

  // An input and what follows from its answer; then throws what a sink threw, unless another call is under way.
  template <class Ask, class Follow>
  std::optional<Answer> concluded(Ask ask, Follow follow) {
    std::optional<Answer> answer;
    {
      const Call call(calls_);
      answer = ask();
      if (answer) follow(*answer);
    }
#if defined(__cpp_exceptions)
    if (calls_ == 0 && thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
#endif
    return answer;
  }

  // `settle` puts the answer's values in order and gives the one to be sent.
  template <class Settle>
  void conclude(const Answer& answer, Settle settle) {
    const Timestamp t = answer.timestamp();
    if (answer.is(FUSELINE_OUTCOME_FORWARDED) || answer.is(FUSELINE_OUTCOME_FINAL) || answer.is(FUSELINE_OUTCOME_MISSED)) forget(t);
    const auto send = [&](auto to) {
      bool has_value = false;
      const bool is_sent = attempt(t, [&] {
        std::optional<Value> value = settle();
        has_value = value.has_value();
        if (value) to(std::move(*value));
      });
      if (is_sent && !has_value) lose(t);
      return has_value;
    };
    if (answer.is(FUSELINE_OUTCOME_FORWARDED)) {
      const bool has_value = send([&](Value&& value) { sink_.forward(t, answer.by(), std::move(value)); });
      // The move of its value threw: the message does not end in silence.
      if (!has_value) attempt(t, [&] { sink_.miss(t); });
    } else if (answer.is(FUSELINE_OUTCOME_PRELIMINARY)) {
      if constexpr (takes_preliminary) send([&](Value&& value) { sink_.preliminary(t, answer.by(), std::move(value)); });
    } else {
      attempt(t, [&] { static_cast<void>(settle()); });
      if (answer.is(FUSELINE_OUTCOME_MISSED)) attempt(t, [&] { sink_.miss(t); });
      if constexpr (takes_preliminary) {
        if (answer.is(FUSELINE_OUTCOME_FINAL)) attempt(t, [&] { sink_.final(t, answer.by()); });
      }
    }
    for (const Priority cloud : answer.cancelled()) attempt(t, [&] { sink_.cancel(t, cloud); });
  }

  // Fails what is pending, the clouds first: local alone could end the message before a better result is looked at.
  void end(Timestamp t) {
    const std::optional<fuseline_message> message = machine_.look_at(t);
    if (!message) return;
    for (std::uint32_t i = message->sources_len; i-- > 0;) {
      if ((message->pending >> i & 1U) != 0) static_cast<void>(fail(t, Priority{message->priorities[i]}));
    }
  }

  void forget(Timestamp t) noexcept {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < open_len_; ++i) {
      if (open_[i] != t) open_[kept++] = open_[i];
    }
    open_len_ = kept;
  }

  void lose(Timestamp t) noexcept {
    ++failures_.len;
    failures_.last = t;
  }

  // Calls the sink. What it throws is kept, the first alone, and counted: then false.
  template <class Function>
  bool attempt(Timestamp t, Function function) {
#if defined(__cpp_exceptions)
    try {
      function();
    } catch (...) {
      const std::exception_ptr now = std::current_exception();
      if (!now) throw;  // no exception of C++: the thread is cancelled, or exits
      lose(t);
      if (!thrown_) thrown_ = now;
      return false;
    }
#else
    static_cast<void>(t);
    function();
#endif
    return true;
  }

  Into& sink_;
  Clock* clock_;  // null if now() is static
  typename Clock::time_point start_ = read();
  Using<Capacity> machine_;
  Held<Value, Capacity> held_{machine_};
  typename Capacity::template Places<Timestamp> open_{machine_.greatest_window()};  // ascending
  std::size_t open_len_ = 0;
  unsigned calls_ = 0;
  SinkFailures failures_;
  std::exception_ptr thrown_;
};

}  // namespace fuseline

#endif  // FUSELINE_HPP
