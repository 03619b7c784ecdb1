// Records an operator whose sink calls it, from chance: `fuseline check` judges what this prints. Run by .ci/c.
//
//     record eager|patient|progressive >run.jsonl

#include "fuseline_capacity.hpp"
#include "fuseline_clock.hpp"
#include "fuseline_record.hpp"
#include "holds.h"

#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace {

using namespace std::chrono_literals;
using fuseline::Commit;
using fuseline::Priority;
using fuseline::Timestamp;

std::uint64_t seed = 7;
std::uint64_t chance(std::uint64_t below) {
  seed = seed * 6364136223846793005U + 1442695040888963407U;
  return (seed >> 33) % below;
}

struct Node {
  std::uint64_t next = 0, outputs = 0;
  unsigned depth = 0;
  fuseline::ManualClock clock;
  fuseline::Operator<int, Node, fuseline::AnyCapacity, fuseline::ManualClock, fuseline::RecordedMachine> op;
  explicit Node(Commit commit) : op(*this, 16, commit, 1s, {{Priority{1}, 4}, {Priority{2}, 9, 3}, {Priority{5}, 9}}, clock) {}

  void forward(Timestamp, Priority, int) { ++outputs, act(); }
  void preliminary(Timestamp, Priority, int) { ++outputs, act(); }
  void final(Timestamp, Priority) { act(); }
  void miss(Timestamp) { act(); }
  void cancel(Timestamp, Priority) { act(); }
  void fired(const fuseline::Firing&) { act(); }

  // One call of any kind, also from within another, also a wrong one; time goes on meanwhile.
  void act() {
    if (depth > 2 || chance(3) == 0) return;
    ++depth;
    HOLDS(clock.advance(std::chrono::nanoseconds(chance(4))));
    const Timestamp t{next - chance(next < 6 ? next + 1 : 6)};
    constexpr std::uint64_t sources[] = {0, 0, 1, 2, 5, 5, 6};
    const Priority p{sources[chance(7)]};
    switch (chance(5)) {
      case 0: open(Timestamp{next + 1 - chance(9) / 8}); break;
      case 1: static_cast<void>(op.offer(t, p, std::chrono::nanoseconds(chance(120)), chance(10))); break;
      case 2: static_cast<void>(op.fail(t, p)); break;
      case 3: static_cast<void>(op.tick()); break;
      default: static_cast<void>(op.result(t, p, 1, meant_for(t)));
    }
    --depth;
  }
  // The message that a reply says its value is meant for: its own, another one, or nothing.
  static std::optional<Timestamp> meant_for(Timestamp t) {
    const auto kind = chance(80);
    return kind > 40 ? std::nullopt : std::optional<Timestamp>(Timestamp{t.count + (kind == 40 ? 1 : 0)});
  }
  void open(Timestamp t) {
    const auto opened = op.open(t, limit());
    if (opened && opened->is(FUSELINE_OUTCOME_ACCEPTED) && t.count > next) next = t.count;
  }
  std::optional<fuseline::Deadline> limit() const {
    const auto kind = chance(9);
    if (kind == 8) return std::chrono::hours(1);  // above the greatest
    return kind > 0 ? std::optional<fuseline::Deadline>(std::chrono::nanoseconds(kind * 20)) : std::nullopt;
  }
};

// The trace ends at the line that could not be written, and is_recording() says so.
void ends_when_the_disk_is_full() {
  for (const bool throws : {false, true}) {
    Node node(Commit::eager);
    int room = 2;
    HOLDS(node.op.record([&](std::string_view) {
      if (--room == 0 && throws) throw std::runtime_error("full");
      return room > 0;
    }));
    HOLDS(node.op.is_recording() && node.op.open(Timestamp{1}).has_value() && !node.op.is_recording());
    HOLDS(node.op.open(Timestamp{2})->is(FUSELINE_OUTCOME_ACCEPTED) && room == 0);
  }
}
void is_refused_when_late() {
  Node node(Commit::eager);
  HOLDS(node.op.open(Timestamp{1}).has_value());
  HOLDS(!node.op.record([](std::string_view) { return true; }));
  Node twice(Commit::eager);
  HOLDS(twice.op.record([](std::string_view) { return true; }) && !twice.op.record([](std::string_view) { return true; }));
}

void fails_what_is_meant_for_another() {
  Node node(Commit::eager);
  std::string trace;
  HOLDS(node.op.record([&](std::string_view line) { return trace += line, true; }));
  HOLDS(node.op.open(Timestamp{1}).has_value());
  HOLDS(node.op.result(Timestamp{1}, Priority{0}, 7, Timestamp{2}).has_value() && node.outputs == 0);
  HOLDS(trace.find("\"ev\":\"fail\"") != std::string::npos && trace.find("\"for\"") == std::string::npos);
  HOLDS(node.op.open(Timestamp{2}).has_value());
  HOLDS(node.op.result(Timestamp{2}, Priority{0}, 7, Timestamp{2}).has_value() && node.outputs == 1);
  HOLDS(trace.find("\"ev\":\"emit\"") < trace.rfind("\"for\":2") && trace.find("\"for\":2") < trace.find("\"ev\":\"emit\""));
}

}  // namespace

int main(int argc, char** argv) {
  ends_when_the_disk_is_full();
  is_refused_when_late();
  fails_what_is_meant_for_another();
  const char* rule = argc > 1 ? argv[1] : "eager";
  const Commit commit = std::strcmp(rule, "eager") == 0     ? Commit::eager
                        : std::strcmp(rule, "patient") == 0 ? Commit::patient
                                                            : Commit::progressive;
  Node node(commit);
  // The function that writes may call the operator too.
  HOLDS(node.op.record([&](std::string_view line) {
    if (chance(50) == 0) node.act();
    return std::fwrite(line.data(), 1, line.size(), stdout) == line.size();
  }));
  for (unsigned i = 0; i < 20000; ++i) node.act();
  HOLDS(node.op.is_recording() && node.outputs > 200);
}
