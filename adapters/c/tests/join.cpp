// Sets of two cameras: complete, due, bounded, each once, with what is dropped (E5, E6, E8). Run by .ci/c.

#include "fuseline_join.hpp"

#include <cstdio>
#include <string>

namespace {

using namespace std::chrono_literals;

int failures = 0;

void check(const std::string& found, const std::string& expected, const char* what) {
  if (found == expected) return;
  std::printf("%s: %s, not %s\n", what, found.c_str(), expected.c_str());
  ++failures;
}

// Two cameras, and what was given and dropped in words.
struct Cameras {
  std::string log;
  fuseline::Join<std::string, int> join{
      20ms, 2,
      [this](const fuseline::JoinedSet<std::string, int>& set) {
        const auto& [left, right] = set.messages;
        const char* causes[] = {"complete", "due", "full"};
        log += std::to_string(set.key) + (left ? " " + *left : " -") + (right ? " " + std::to_string(*right) : " -") + " " +
               causes[static_cast<int>(set.cause)] + "; ";
      },
      [this](const fuseline::JoinDrop& drop) {
        log += std::to_string(drop.key) + " of " + std::to_string(drop.input) +
               (drop.why == fuseline::JoinDropReason::late ? " late; " : " twice; ");
      }};

  static fuseline::Join<>::Instant at(std::chrono::milliseconds since) { return fuseline::Join<>::Instant(since); }
  void left(std::chrono::milliseconds now, std::uint64_t key) {
    join.arrive<0>(at(now), key, std::make_shared<const std::string>("L"));
  }
  void right(std::chrono::milliseconds now, std::uint64_t key) { join.arrive<1>(at(now), key, std::make_shared<const int>(7)); }
  std::string take() { return std::exchange(log, {}); }
};

void gives_complete_sets_at_once_and_others_when_due() {
  Cameras cameras;
  cameras.left(0ms, 1);
  cameras.right(5ms, 1);
  check(cameras.take(), "1 L 7 complete; ", "complete");
  check(cameras.join.next_due() ? "due" : "none", "none", "nothing waits");
  cameras.right(6ms, 2);
  check(cameras.join.next_due() == Cameras::at(26ms) ? "26" : "else", "26", "the due instant");
  cameras.join.tick(Cameras::at(26ms) - 1ns);
  check(cameras.take(), "", "just before it is due");
  cameras.join.tick(Cameras::at(26ms));
  check(cameras.take(), "2 - 7 due; ", "as it is due");
}

void what_comes_late_or_twice_is_dropped_and_reported() {
  Cameras cameras;
  cameras.left(0ms, 1);
  cameras.left(1ms, 1);
  cameras.right(20ms, 1);
  check(cameras.take(), "1 of 0 twice; 1 L - due; 1 of 1 late; ", "drops");
  cameras.join.arrive<0>(Cameras::at(21ms), 2, nullptr);
  check(cameras.join.next_due() ? "due" : "none", "none", "a null message");
}

void the_oldest_set_makes_room_and_no_key_opens_again() {
  Cameras cameras;
  cameras.left(0ms, 9);
  cameras.left(1ms, 8);
  cameras.left(2ms, 10);
  check(cameras.take(), "9 L - full; ", "room");
  cameras.join.tick(Cameras::at(50ms));
  for (std::uint64_t key = 11; key < 3000; ++key) {
    cameras.left(60ms, key);
    cameras.right(60ms, key);
  }
  cameras.take();
  for (std::uint64_t key = 8; key < 3000; ++key) cameras.left(70ms, key);
  check(cameras.join.next_due() ? "open" : "none", "none", "keys that were given");
}

}  // namespace

int main() {
  gives_complete_sets_at_once_and_others_when_due();
  what_comes_late_or_twice_is_dropped_and_reported();
  the_oldest_set_makes_room_and_no_key_opens_again();
  return failures == 0 ? 0 : 1;
}
