// Maps a sensor's stamps to timestamps, so that a reply with a copied stamp finds its message. For C++17, header
// only.

#ifndef FUSELINE_STAMPS_HPP
#define FUSELINE_STAMPS_HPP

#include "fuseline.hpp"

#include <array>
#include <cstddef>
#include <optional>
#include <type_traits>

namespace fuseline {

// A bounded map from stamps to timestamps, which allocates nothing. It refuses a stamp that is among the last
// `Remembered`, because a reply with that stamp could belong to either message. Stamps repeat if a driver
// leaves every stamp 0, or if a recording is played twice.
template <class Stamp, std::size_t Remembered = 1024>
class Stamps {
  static_assert(Remembered > 0, "the number of remembered stamps must be at least 1");
  static_assert(!std::is_floating_point_v<Stamp>, "a stamp is a whole number or a type of yours: one that is rounded is not found");

 public:
  // Returns the next timestamp, for a message with this stamp. Returns nothing if the stamp is remembered;
  // report that, and do not open a timestamp.
  [[nodiscard]] std::optional<Timestamp> add(const Stamp& stamp) {
    if (find(stamp)) {
      ++repeated_;
      return std::nullopt;
    }
    places_[next_ % Remembered] = stamp;
    return Timestamp{next_++};
  }

  // Returns the timestamp of the message with this stamp, or nothing if there was none among the last
  // `Remembered`.
  [[nodiscard]] std::optional<Timestamp> find(const Stamp& stamp) const {
    const std::uint64_t oldest = next_ < Remembered ? 0 : next_ - Remembered;
    for (std::uint64_t t = next_; t-- > oldest;) {
      if (places_[t % Remembered] == stamp) return Timestamp{t};
    }
    return std::nullopt;
  }

  // Returns the stamp of a timestamp, while it is remembered.
  [[nodiscard]] std::optional<Stamp> stamp_of(Timestamp t) const {
    if (t.count >= next_ || next_ - t.count > Remembered) return std::nullopt;
    return places_[t.count % Remembered];
  }

  // Returns the number of messages that were refused.
  std::uint64_t repeated() const noexcept { return repeated_; }

 private:
  std::array<Stamp, Remembered> places_{};
  std::uint64_t next_ = 0;
  std::uint64_t repeated_ = 0;
};

}  // namespace fuseline

#endif  // FUSELINE_STAMPS_HPP
