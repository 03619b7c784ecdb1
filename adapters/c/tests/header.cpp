// The header under every warning of gcc and clang: included twice, its templates used with durations of all kinds.
#include "fuseline.hpp"
#include "fuseline.hpp"
#include "fuseline_capacity.hpp"
#include "fuseline_clock.hpp"
#include "fuseline_stamps.hpp"
struct S : fuseline::Sink<int> {
  void forward(fuseline::Timestamp, fuseline::Priority, int) {}
  void miss(fuseline::Timestamp) {}
};
struct R : S {
  void preliminary(fuseline::Timestamp, fuseline::Priority, int) {}
  void final(fuseline::Timestamp, fuseline::Priority) {}
};
// A node that is its own sink: the operator is made where the sink's type is not complete yet.
struct N : fuseline::Sink<int> {
  void forward(fuseline::Timestamp, fuseline::Priority, int) {}
  void miss(fuseline::Timestamp) {}
  fuseline::Operator<int, N> op{*this, 16, fuseline::Commit::eager, std::chrono::seconds(1), {{fuseline::Priority{1}, 8}}};
};
int main() {
  const N n;
  fuseline::Machine<> m(16, fuseline::Commit::eager, std::chrono::seconds(1), {});
  S s;
  fuseline::Operator<int, S> op(s, 16, fuseline::Commit::eager, std::chrono::milliseconds(1), {});
  (void)op.open(fuseline::Timestamp{1}, std::chrono::duration<double>(0.1));
  (void)op.open(fuseline::Timestamp{1}, std::chrono::duration<float, std::milli>(0.1F));
  (void)op.open(fuseline::Timestamp{1}, std::chrono::duration<unsigned short, std::ratio<1, 30>>(std::uint16_t{1}));
  (void)op.open(fuseline::Timestamp{1}, std::chrono::duration<int>(1) - std::chrono::hours(2));
  (void)op.offer(fuseline::Timestamp{1}, fuseline::Priority{1}, std::chrono::duration<std::uint64_t>(1), 0);
  (void)op.result(fuseline::Timestamp{1}, fuseline::Priority{1}, 1);
  (void)op.fail(fuseline::Timestamp{1}, fuseline::Priority{1});
  (void)op.next_due();
  R r;
  const fuseline::Operator<int, R> revised(r, 16, fuseline::Commit::progressive, std::chrono::milliseconds(1), {});
  for (auto p : op.fail(fuseline::Timestamp{1}, fuseline::Priority{1})->cancelled()) (void)p;
  fuseline::ManualClock manual;
  fuseline::ReadClock read([&] { return manual.now().time_since_epoch(); });
  fuseline::Operator<int, S, fuseline::AnyCapacity, decltype(read)> any(s, 9, fuseline::Commit::patient, std::chrono::seconds(1), {}, read);
  if (!manual.advance(std::chrono::duration<float>(0.5F)) || !any.tick()) return 1;
  return m && n.op && revised && m.look() && op.tick() ? 0 : 1;
}
