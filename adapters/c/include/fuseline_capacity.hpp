// Capacities that are chosen at run time, for C++17, header only, over fuseline.hpp.
//
//   std::vector<fuseline::Cloud> clouds = /* from a file */;
//   fuseline::Operator<Boxes, Planner, fuseline::AnyCapacity> op(planner, window, Commit::eager, 1s, clouds.data(), clouds.size());
//
// Unlike fuseline.hpp it allocates, but only when an operator or a machine is made.

#ifndef FUSELINE_CAPACITY_HPP
#define FUSELINE_CAPACITY_HPP

#include "fuseline.hpp"

#include <vector>

namespace fuseline {

// The smallest capacity of the library that has room for a machine's clouds and window. If there is none, no
// machine is made, and the status is FUSELINE_STATUS_CAPACITY.
struct AnyCapacity {
  class Storage {
   public:
    Storage(std::size_t clouds, std::size_t window)
        : capacity_(smallest(clouds, window)), window_(capacity_ == 0 ? 0 : window), words_(fuseline_bytes(capacity_) / 8 + 1) {}
    std::uint32_t capacity() const noexcept { return capacity_; }
    std::size_t window() const noexcept { return window_; }
    std::size_t bytes() const noexcept { return words_.size() * sizeof(std::uint64_t); }
    void* data() noexcept { return words_.data(); }

   private:
    static std::uint32_t smallest(std::size_t clouds, std::size_t window) noexcept {
      std::uint32_t best = 0;
      for (const std::uint32_t it : {C1W4::id, C3W16::id, C7W64::id, C15W1024::id, fuseline_own_capacity()}) {
        const std::size_t bytes = fuseline_bytes(it);
        const bool has_room = bytes > 0 && clouds <= it >> 16 && window <= (it & 0xFFFFU);
        if (has_room && (best == 0 || bytes < fuseline_bytes(best))) best = it;
      }
      return best;
    }

    std::uint32_t capacity_;
    std::size_t window_;
    std::vector<std::uint64_t> words_;
  };
  template <class Place>
  using Places = std::vector<Place>;
};

}  // namespace fuseline

#endif  // FUSELINE_CAPACITY_HPP
