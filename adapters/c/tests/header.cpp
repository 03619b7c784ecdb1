// The header under every warning of gcc and clang: included twice, its templates used with durations of all kinds.
#include "fuseline.hpp"
#include "fuseline.hpp"
struct S : fuseline::Sink<int> {};
struct R : fuseline::Sink<int> {
  void preliminary(fuseline::Timestamp, fuseline::Priority, int) {}
  void final(fuseline::Timestamp, fuseline::Priority) {}
};
int main() {
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
  return m && revised && m.look() && op.tick() ? 0 : 1;
}
