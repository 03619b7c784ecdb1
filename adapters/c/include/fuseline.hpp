// Fuseline for C++17, header only, over fuseline.h: it needs no exceptions, no RTTI and no allocation.
//
//   Machine<Capacity>   the machine, with answers as in C and the types of C++
//   Held<Value, C>      the values of held results, which may be move-only
//   Operator<...>       an operator for one thread: both, with a clock and a sink
//
// Exceptions: this header throws none of its own. A sink, a function `fired`, a clock and the move of a value may throw;
// Machine, Held and Operator say what happens then. Destructors must not throw. The destructor of a value may call the
// operator that held it.
//
// Identifiers such as (F5), (P3) and (A10) name rules, promises and ambiguities of SPEC.md in the project's repository.

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

// Returns the nanoseconds of any std::chrono duration, rounded down. Returns 0 if it is negative or not a
// number, and the greatest number if it does not fit.
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
    static_assert(num <= greatest / den, "the unit of this duration cannot be counted in nanoseconds");
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

// The time that a request, or local, may take. Any std::chrono duration converts. A duration of 0 or less is
// refused as `deadline`. A duration that is too long becomes the longest deadline. A plain number does not
// convert, because it has no unit.
class Deadline {
 public:
  template <class Rep, class Period>
  constexpr Deadline(const std::chrono::duration<Rep, Period>& duration) noexcept : ns_(nanoseconds_of(duration)) {}
  constexpr std::uint64_t ns() const noexcept { return ns_; }

 private:
  std::uint64_t ns_;
};

// A reading of your monotonic clock, in nanoseconds from any fixed start. A reading before the start becomes
// 0, and a reading that is too late becomes the last instant. The difference of two instants is a
// std::chrono::nanoseconds with a sign, which saturates.
class Instant {
 public:
  constexpr Instant() noexcept = default;
  template <class Clock, class Elapsed>
  explicit constexpr Instant(const std::chrono::time_point<Clock, Elapsed>& reading) noexcept
      : ns_(nanoseconds_of(reading.time_since_epoch())) {
    static_assert(Clock::is_steady, "Fuseline takes a steady clock: others are set back and forth");
  }
  // Returns an instant from a reading, since its start, of a clock that std::chrono does not have. Nothing
  // checks that the clock is monotonic. The time of day is not, and neither is a counter of ticks that wraps.
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

// Counts the messages of an operator. It is not a time of day.
struct Timestamp {
  std::uint64_t count = 0;
  friend constexpr bool operator==(Timestamp a, Timestamp b) noexcept { return a.count == b.count; }
  friend constexpr bool operator!=(Timestamp a, Timestamp b) noexcept { return a.count != b.count; }
  friend constexpr bool operator<(Timestamp a, Timestamp b) noexcept { return a.count < b.count; }
};

// Ranks the results of a source: 0 is local, clouds have 1 to 65535, and the greater number wins.
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

// The capacity of a machine, and its storage. If the library was not built for exactly this many clouds and
// this window, no machine is made, and the status is FUSELINE_STATUS_CAPACITY. The header
// fuseline_capacity.hpp has a capacity that is chosen at run time.
template <std::size_t Clouds, std::size_t Window>
struct Capacity {
  static_assert(Clouds < FUSELINE_SOURCES, "a machine has at most 15 clouds");
  static_assert(Window >= 1 && Window <= 1024, "a machine has a window of 1 to 1024");
  static constexpr std::uint32_t id = FUSELINE_CAPACITY_OF(Clouds, Window);

  // The storage of a machine, inside the machine object.
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
// The capacity that the library was built for: FUSELINE_OWN_CLOUDS and FUSELINE_OWN_WINDOW.
template <std::size_t Clouds, std::size_t Window>
using Own = Capacity<Clouds, Window>;

// Configures one cloud. Its gate shuts at `limit` queued requests, and opens again at `resume` or fewer. By
// default `resume` is limit - 1.
struct Cloud {
  Priority priority;
  std::uint64_t limit = 1;
  std::optional<std::uint64_t> resume = std::nullopt;
};

// A set of priorities, in ascending order. It is a copy, so it may outlive its answer.
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

// The outcome of an input.
class Answer {
 public:
  explicit Answer(const fuseline_answer& plain) noexcept : plain_(plain) {}
  Instant at() const noexcept { return Instant::from_monotonic(detail::Nanoseconds(plain_.at)); }
  Timestamp timestamp() const noexcept { return Timestamp{plain_.t}; }
  Outcome outcome() const noexcept { return plain_.outcome; }
  bool is(Outcome outcome) const noexcept { return plain_.outcome == outcome; }
  // Returns the reason why the input was refused or dropped, or FUSELINE_REASON_NONE if it was neither.
  Reason why() const noexcept { return plain_.why; }
  // Returns the source whose result is forwarded, preliminary or final.
  Priority by() const noexcept { return Priority{plain_.by}; }
  // Returns the due instant of an admitted request, or of the timers that fired.
  Instant due() const noexcept { return Instant::from_monotonic(detail::Nanoseconds(plain_.due)); }
  // Returns the clouds whose results are no longer wanted.
  Priorities cancelled() const noexcept { return {plain_.cancelled, plain_.cancelled_len}; }

 protected:
  fuseline_answer plain_;
};

// The answer to an open or an offer. It converts to true if the message is accepted or the request admitted.
// A refused message must not be computed, and a refused request must not be sent. has_value() says whether
// there is an answer at all.
class Decision : public std::optional<Answer> {
 public:
  using std::optional<Answer>::optional;
  explicit Decision(std::optional<Answer>&& answer) noexcept : std::optional<Answer>(std::move(answer)) {}
  explicit operator bool() const noexcept {
    return has_value() && ((*this)->is(FUSELINE_OUTCOME_ACCEPTED) || (*this)->is(FUSELINE_OUTCOME_ADMITTED));
  }
};

// The outcome of timers that fired before an input (F5).
class Firing : public Answer {
 public:
  using Answer::Answer;
  Priorities timers() const noexcept { return {plain_.timers, plain_.timers_len}; }
};

// One operator's machine, with its storage. It cannot be moved.
//
// Each input first passes each firing to `fired`, as a const Firing&. It then returns its own answer,
// or nothing if status() says that the machine could not be called. `greatest_deadline` is the longest
// time that the system may wait for a message; a longer deadline is refused as `deadline`.
//
// If `fired` throws, its firing has happened but the input has not. Handle the firing, and call again.
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
    // A window that does not fit 32 bits exceeds every capacity, as the greatest number of 32 bits does.
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

  // Returns FUSELINE_STATUS_DONE, or the reason why the last call of the machine failed. If the machine could
  // not be made, the reason stays.
  Status status() const noexcept { return status_; }
  explicit operator bool() const noexcept { return machine_ != nullptr; }

  // Returns the greatest number of messages that its capacity allows to be open.
  std::size_t greatest_window() const noexcept { return storage_.window(); }

  // Opens a timestamp because a message with it arrived (F1). `limit` is how long local may take for it.
  template <class Fired>
  [[nodiscard]] Decision open(Instant now, Timestamp t, std::optional<Deadline> limit, Fired&& fired) {
    return Decision(ask(fired, [&](fuseline_answer* answer) {
      return limit ? fuseline_open_within(machine_, now.ns(), t.count, limit->ns(), answer)
                   : fuseline_open(machine_, now.ns(), t.count, answer);
    }));
  }

  // Asks whether the message may be sent to this cloud (F2). `backlog` is the number of other requests in its
  // queue.
  template <class Fired>
  [[nodiscard]] Decision offer(Instant now, Timestamp t, Priority cloud, Deadline deadline, std::uint64_t backlog,
                               Fired&& fired) {
    return Decision(ask(fired, [&](fuseline_answer* answer) {
      return fuseline_offer(machine_, now.ns(), t.count, cloud.number, deadline.ns(), backlog, answer);
    }));
  }

  // Reports the result of a source (F3). Only a machine that records looks at `meant_for`.
  template <class Fired>
  [[nodiscard]] std::optional<Answer> result(Instant now, Timestamp t, Priority source, Fired&& fired,
                                             std::optional<Timestamp> meant_for = std::nullopt) {
    static_cast<void>(meant_for);
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_result(machine_, now.ns(), t.count, source.number, answer);
    });
  }

  // Reports that no result will come from a source (F4).
  template <class Fired>
  [[nodiscard]] std::optional<Answer> fail(Instant now, Timestamp t, Priority source, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) {
      return fuseline_fail(machine_, now.ns(), t.count, source.number, answer);
    });
  }

  // Lets time pass (F0).
  template <class Fired>
  [[nodiscard]] std::optional<Answer> tick(Instant now, Fired&& fired) {
    return ask(fired, [&](fuseline_answer* answer) { return fuseline_tick(machine_, now.ns(), answer); });
  }

  // Returns the next due instant; tick then. Returns nothing if no timer is armed, or if status() is not
  // FUSELINE_STATUS_DONE.
  [[nodiscard]] std::optional<Instant> next_due() noexcept {
    std::uint64_t due = 0;
    if (!answered([&] { return fuseline_next_due(machine_, &due); })) return std::nullopt;
    return Instant::from_monotonic(detail::Nanoseconds(due));
  }

  // Ends the machine. Later calls have no answer, and their status is FUSELINE_STATUS_FOREIGN.
  void end() noexcept {
    if (machine_ == nullptr) return;
    static_cast<void>(fuseline_end(machine_));
    machine_ = nullptr;
    status_ = FUSELINE_STATUS_FOREIGN;
  }

  // Returns the state of an open message. Returns nothing if it is not open, or if status() is not
  // FUSELINE_STATUS_DONE.
  [[nodiscard]] std::optional<fuseline_message> look_at(Timestamp t) noexcept {
    fuseline_message message{};
    if (!answered([&] { return fuseline_look_at(machine_, t.count, &message); })) return std::nullopt;
    return message;
  }

  // Returns the state of the machine.
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

  // Asks a query and returns whether it has an answer. FUSELINE_STATUS_NONE is not a failure.
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

// Stores the value of the best held result of each open timestamp, because no other value can be forwarded
// (P3). Pass it each answer and each firing. It then destroys each value as soon as that value cannot be
// forwarded any more. It takes its machine as an argument, to have a place for each timestamp that the
// machine may open.
//
// A value is destroyed while all others are in their places, so its destructor may call the owner of this
// store. If the move of a value throws, only that value is lost, and lost() counts it if it was to be sent.
template <class Value, class Capacity>
class Held {
  static_assert(detail::is_value<Value>, "a value is an object that can be moved: neither const, nor a reference, an array or void");

 public:
  explicit Held(const Machine<Capacity>& machine) : places_(machine.greatest_window()) {}

  // Takes a result's value and its answer. Returns the value to be sent downstream, if one is.
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

  // Takes the answer to a failure, or a firing. Returns the value to be sent downstream, if one is.
  [[nodiscard]] std::optional<Value> settled(const Answer& answer) {
    if (is_output(answer)) {
      std::optional<Value> value = take(answer.timestamp(), answer.by());
      lost_ += value ? 0U : 1U;
      return value;
    }
    if (answer.is(FUSELINE_OUTCOME_MISSED)) discard(answer.timestamp());
    return std::nullopt;
  }

  // Returns the number of values that found no place, or were missing when they were to be sent. It is not 0
  // if an answer or a firing was not passed, if another machine's was passed, or if the move of a value
  // threw.
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

  // A place that is being emptied belongs to nobody, because the destructor of its value may call this store.
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

  // Destroys the value that is replaced last, when the better one is in its place.
  void replace(Place& place, Priority source, Value&& value) {
    if (source < place.source && place.source != no_source) return;
    [[maybe_unused]] const Value outdone(std::move(*place.value));
    place.source = no_source;  // stays if the next line throws: then nothing is held here that could be sent
    *place.value = std::move(value);
    place.source = source;
  }

  // Empties the timestamp's place. Returns its value if its source is `by`.
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

  // Empties the timestamp's place. Its value is destroyed when the place is free again, unless the move can
  // throw.
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

// The base of an operator's sink, with the functions that a sink may omit. Derive from it. The sink
// must have two functions, or its operator does not compile:
//
//     void forward(Timestamp, Priority, Value);  // the last or only output of a message: send it
//     void miss(Timestamp);                      // the message has no output
//
// Each accepted message leads to exactly one call of one of the two; under Commit::progressive, `final` may
// take that call's place. Name the sink's own type in the operator, because nothing here is virtual. A base
// of the sink does not compile, except in two cases: it has virtual functions, or it has the two functions
// itself and the operator never saw the derived type.
//
// Under Commit::progressive a sink needs two more functions. Without them no operator is made, and
// the status is FUSELINE_STATUS_COMMIT.
//
//     void preliminary(Timestamp, Priority, Value);  // send it; better ones may follow
//     void final(Timestamp, Priority);               // the last value that was sent is final
template <class Value>
struct Sink {
  // The result of this cloud is no longer wanted. Its call may be aborted.
  void cancel(Timestamp, Priority) {}
  // Timers fired. This is for records; the other functions report the consequences.
  void fired(const Firing&) {}
};

namespace detail {
// True if a sink takes outputs.
template <class Into, class Value, class = void>
struct TakesOutputs : std::false_type {};
template <class Into, class Value>
struct TakesOutputs<Into, Value,
                    std::void_t<decltype(std::declval<Into&>().forward(Timestamp(), Priority(), std::declval<Value>())),
                                decltype(std::declval<Into&>().miss(Timestamp()))>> : std::true_type {};

// True if a sink takes outputs before the last one.
template <class Into, class Value, class = void>
struct TakesPreliminary : std::false_type {};
template <class Into, class Value>
struct TakesPreliminary<Into, Value,
                        std::void_t<decltype(std::declval<Into&>().preliminary(Timestamp(), Priority(), std::declval<Value>())),
                                    decltype(std::declval<Into&>().final(Timestamp(), Priority()))>> : std::true_type {};
}  // namespace detail

namespace detail {
// True if a clock is an object, which the operator must be given. The clocks of the standard library have a
// static now().
template <class Clock, class = void>
struct IsObject : std::true_type {};
template <class Clock>
struct IsObject<Clock, std::void_t<decltype(Clock::now())>> : std::false_type {};
}  // namespace detail

// Counts what an operator could not deliver.
struct SinkFailures {
  std::size_t len = 0;  // calls of the sink that threw, moves of values that threw, and outputs without a value after that
  Timestamp last;       // the message of the last of them, if there is one
};

// An operator for one thread: the machine, the values of held results, a clock, and a sink for outputs.
//
// Each function reads the clock, passes what is due to the sink, and then does its own work. Wake up at
// next_due() and tick. The sink is not called for a message whose open is refused, so the caller must
// report that message.
//
// An exception of the sink stops nothing. The operator still does everything that is due, applies the input,
// and calls the sink's other functions. When result, fail or tick ends, it throws the first of the
// exceptions. If a sink or a destructor called the operator, the outermost call throws. Open and offer do not
// throw it, because their answer would be lost. The next result, fail or tick throws it. sink_failures()
// counts each exception at once. The clock is read before anything is done. If it throws, the value that was
// passed to result is lost.
//
// The destructor ends the machine first. If the destructor of a held value then calls the operator, the
// status is FUSELINE_STATUS_FOREIGN. An operator that is destroyed within a call of its own, for example by
// its sink, ends the program by std::terminate.
//
// `Clock` is a type of steady clock. If its now() is not static, pass a clock object after the clouds; it
// must live longer than the operator. fuseline_clock.hpp has two such clocks.
//
// `Using` is the machine; fuseline_record.hpp has one that records.
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
    // Its own sink, or the destructor of a value, would continue with an operator that no longer exists.
    if (calls_ > 0) std::terminate();
    machine_.end();
  }

  Status status() const noexcept { return machine_.status(); }
  explicit operator bool() const noexcept { return static_cast<bool>(machine_); }

  // Opens a message. If it is accepted, compute it on board and offer it to the clouds.
  [[nodiscard]] Decision open(Timestamp t, std::optional<Deadline> limit = std::nullopt) {
    const Call call(calls_);
    const Decision answer = machine_.open(now(), t, limit, fired());
    if (answer && open_len_ < open_.size()) open_[open_len_++] = t;
    return answer;
  }

  // Offers the message to this cloud. Send it if it is admitted.
  [[nodiscard]] Decision offer(Timestamp t, Priority cloud, Deadline deadline, std::uint64_t backlog) {
    const Call call(calls_);
    return machine_.offer(now(), t, cloud, deadline, backlog, fired());
  }

  // Takes a source's result with this value. `meant_for` is the message that the value is meant for, as the reply
  // states it: never copy `t`. A value that is meant for another message counts as a failure of its source (D18).
  std::optional<Answer> result(Timestamp t, Priority source, Value value, std::optional<Timestamp> meant_for = std::nullopt) {
    if (meant_for && meant_for->count != t.count) return fail(t, source);
    return concluded([&] { return machine_.result(now(), t, source, fired(), meant_for); },
                     [&](const Answer& answer) {
                       conclude(answer, [&] { return held_.result(source, std::move(value), answer); });
                     });
  }

  // Reports that no result will come from this source.
  std::optional<Answer> fail(Timestamp t, Priority source) {
    return concluded([&] { return machine_.fail(now(), t, source, fired()); },
                     [&](const Answer& answer) { conclude(answer, [&] { return held_.settled(answer); }); });
  }

  // Lets time pass. Returns false if the machine could not be called.
  bool tick() {
    return concluded([&] { return machine_.tick(now(), fired()); }, [](const Answer&) {}).has_value();
  }

  // Ends the open messages, the oldest first. Everything pending fails, so each message is forwarded with its
  // best available result, or missed. Under Commit::progressive its last output, if there is one, becomes
  // final. The operator can still be used afterwards. Returns false if the machine could not be called.
  bool drain() {
    return concluded(
               [&] {
                 // A copy, so that messages which a sink opens meanwhile stay open.
                 const auto opened = open_;
                 const std::size_t len = open_len_;
                 for (std::size_t i = 0; i < len; ++i) end(opened[i]);
                 return machine_.tick(now(), fired());
               },
               [](const Answer&) {})
        .has_value();
  }

  // Returns the instant to tick next. Returns nothing if no timer is armed, or if status() is not
  // FUSELINE_STATUS_DONE.
  [[nodiscard]] std::optional<typename Clock::time_point> next_due() noexcept {
    const std::optional<Instant> due = machine_.next_due();
    if (!due) return std::nullopt;
    using Rest = typename Clock::duration;
    using Reading = typename Clock::time_point;
    const Rest room = start_ < Reading() ? Reading::max().time_since_epoch() : Reading::max() - start_;
    if (due->ns() >= nanoseconds_of(room)) return Reading::max();
    // The instant is rounded up, because a tick before the due instant fires nothing.
    const Rest rest = std::chrono::duration_cast<Rest>(detail::Nanoseconds(due->ns()));
    return start_ + (nanoseconds_of(rest) < due->ns() ? rest + Rest(1) : rest);
  }

  // Returns the number of values held.
  std::size_t held() const noexcept { return held_.size(); }

  // Begins the trace, before the first message. It needs a machine that records, as in fuseline_record.hpp.
  template <class Write>
  [[nodiscard]] bool record(Write write) {
    return machine_.record(std::move(write));
  }
  bool is_recording() const noexcept { return machine_.is_recording(); }

  // Returns what could not be delivered because the sink, or the move of a value, threw.
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

  // Returns the commit rule, or one that no machine has if the sink does not take its outputs.
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

  // Runs an input and what follows from its answer. Then throws the first exception of the sink, unless
  // another call is under way.
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

  // Calls `settle`, which updates the stored values and returns the one to be sent.
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
      // The move of its value threw, so the message is reported as missed.
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

  // Fails everything pending, the clouds first, because local alone could end the message before a better
  // result is considered.
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

  // Calls the sink. Returns false if it throws. The exception is counted, and the first one is kept.
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
