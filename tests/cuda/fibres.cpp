// SPDX-License-Identifier: Apache-2.0
// Runs the threads of a CUDA block as fibres, one at a time. They switch at barriers and warp operations.
// The environment variable UBS_CUDA_ON_HOST_ORDER selects which fibre continues:
// - forward (default): threads in ascending order
// - reverse: threads in descending order
// - greedy: threads of the same warp as long as possible, so that a warp runs as far ahead of the other warps
//   as the barriers allow
// - a number: the seed of a random order of threads and blocks
// If a necessary barrier is missing, the results of a kernel depend on the order. For each barrier in the
// rasterisers and the loss, tests with the forward or the greedy order fail if the barrier is removed
// (README.md in this folder).
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tests/cuda/include/cuda_runtime.h"

#if !defined(__x86_64__)
#include <ucontext.h>
#endif

namespace cuda_on_host {

dim3 grid_size, block_size;
uint3 block_position{0, 0, 0};

namespace {

constexpr std::size_t kStackBytes = std::size_t{128} << 10;
constexpr unsigned kLanes = 32;

[[noreturn]] void stop(const char* what) {
  std::fprintf(stderr, "CUDA on the host: %s (block %u, %u, %u)\n", what, block_position.x, block_position.y,
               block_position.z);
  std::abort();
}

// ---- Switching stacks ----

#if defined(__x86_64__)
using Context = void*;
extern "C" void ubs_fibre_switch(Context* save, Context load);
asm(R"(
.text
.globl ubs_fibre_switch
.type ubs_fibre_switch, @function
ubs_fibre_switch:
  pushq %rbp
  pushq %rbx
  pushq %r12
  pushq %r13
  pushq %r14
  pushq %r15
  movq %rsp, (%rdi)
  movq %rsi, %rsp
  popq %r15
  popq %r14
  popq %r13
  popq %r12
  popq %rbx
  popq %rbp
  ret
.size ubs_fibre_switch, .-ubs_fibre_switch
)");
void prepare(Context& context, char* stack, void (*entry)()) {
  auto* top = reinterpret_cast<void**>(stack + kStackBytes);
  *--top = nullptr;  // so that the stack is aligned as after a call instruction
  *--top = reinterpret_cast<void*>(entry);
  for (int i = 0; i < 6; ++i) *--top = nullptr;
  context = top;
}
void change(Context& from, Context& to) { ubs_fibre_switch(&from, to); }
#else
using Context = ucontext_t;
void prepare(Context& context, char* stack, void (*entry)()) {
  getcontext(&context);
  context.uc_stack.ss_sp = stack;
  context.uc_stack.ss_size = kStackBytes;
  makecontext(&context, entry, 0);
}
void change(Context& from, Context& to) { swapcontext(&from, &to); }
#endif

// ---- One block ----

// A point at which fibres wait for each other. When the last of them arrives, `generation` changes, and all
// continue.
struct Meeting {
  unsigned arrived = 0, generation = 0;
};
struct Fibre {
  Context context;
  uint3 position;
  const Meeting* waits_for = nullptr;
  unsigned seen = 0;
  bool done = false;

  bool runnable() const { return !done && (!waits_for || waits_for->generation != seen); }
};
// A warp stores the values of two generations, because the next exchange may start while lanes still read the
// values of the previous one.
struct Warp {
  Meeting meeting;
  std::uint32_t values[2][kLanes];
};

struct Block {
  std::vector<Fibre> fibres;
  std::vector<unsigned> order, place;  // order[place[i]] == i
  std::vector<Warp> warps;
  Meeting all;
  unsigned current = 0, alive = 0;
  Context outside;
  const std::function<void()>* kernel = nullptr;
};
Block block;

const std::string& wanted_order() {
  static const char* const variable = std::getenv("UBS_CUDA_ON_HOST_ORDER");
  static const std::string wanted = variable ? variable : "forward";
  return wanted;
}

void go_on_with(unsigned next) {
  const unsigned here = block.current;
  if (next == here) return;
  block.current = next;
  change(block.fibres[here].context, block.fibres[next].context);
}

void give_way() {
  const auto count = static_cast<unsigned>(block.fibres.size());
  const unsigned here = block.current;
  if (block.alive == 0) change(block.fibres[here].context, block.outside);
  if (static const bool greedy = wanted_order() == "greedy"; greedy)
    for (unsigned step = 1; step <= kLanes; ++step) {
      const unsigned mate = here / kLanes * kLanes + (here + step) % kLanes;
      if (mate < count && block.fibres[mate].runnable()) return go_on_with(mate);
    }
  for (unsigned step = 1; step <= count; ++step) {
    const unsigned next = block.order[(block.place[here] + step) % count];
    if (block.fibres[next].runnable()) return go_on_with(next);
  }
  stop("not all threads of the block reach a barrier or warp operation");
}

void meet(Meeting& meeting, unsigned needed) {
  Fibre& fibre = block.fibres[block.current];
  if (++meeting.arrived == needed) {
    meeting.arrived = 0;
    ++meeting.generation;
    return;
  }
  fibre.waits_for = &meeting;
  fibre.seen = meeting.generation;
  while (meeting.generation == fibre.seen) give_way();
  fibre.waits_for = nullptr;
}

void fibre_main() {
  (*block.kernel)();
  block.fibres[block.current].done = true;
  --block.alive;
  give_way();
  stop("a finished thread continued");
}

std::vector<unsigned> make_order(unsigned count, unsigned salt) {
  const std::string& wanted = wanted_order();
  std::vector<unsigned> order(count);
  for (unsigned i = 0; i < count; ++i) order[i] = wanted == "reverse" ? count - 1 - i : i;
  if (wanted != "forward" && wanted != "reverse" && wanted != "greedy") {
    std::mt19937 random(static_cast<unsigned>(std::stoul(wanted)) + salt);
    for (unsigned i = count; i > 1; --i) std::swap(order[i - 1], order[random() % i]);
  }
  return order;
}

void run_block(const std::vector<std::unique_ptr<char[]>>& stacks) {
  const unsigned count = block_size.x;
  block.alive = count;
  block.all = {};
  block.warps.assign((count + kLanes - 1) / kLanes, {});
  for (unsigned i = 0; i < count; ++i) {
    Fibre& fibre = block.fibres[i];
    fibre.position = {i, 0, 0};
    fibre.waits_for = nullptr;
    fibre.done = false;
    prepare(fibre.context, stacks[i].get(), fibre_main);
  }
  block.current = block.order[0];
  change(block.outside, block.fibres[block.current].context);
}

}  // namespace

const uint3& thread_position() { return block.fibres[block.current].position; }
unsigned lane() { return block.current % kLanes; }
void barrier() { meet(block.all, static_cast<unsigned>(block.fibres.size())); }

std::uint32_t exchange(std::uint32_t value, unsigned mask, unsigned source) {
  if (mask != 0xffffffffu) stop("a warp operation does not include all threads of the warp");
  Warp& warp = block.warps[block.current / kLanes];
  const unsigned generation = warp.meeting.generation;
  warp.values[generation % 2][lane()] = value;
  meet(warp.meeting, kLanes);
  return warp.values[generation % 2][source];
}

unsigned ballot(unsigned mask, bool value) {
  if (mask != 0xffffffffu) stop("a warp operation does not include all threads of the warp");
  Warp& warp = block.warps[block.current / kLanes];
  const unsigned generation = warp.meeting.generation;
  warp.values[generation % 2][lane()] = value;
  meet(warp.meeting, kLanes);
  unsigned bits = 0;
  for (unsigned i = 0; i < kLanes; ++i) bits |= warp.values[generation % 2][i] << i;
  return bits;
}

void run(dim3 grid, dim3 block_shape, const std::function<void()>& kernel) {
  if (block_shape.y != 1 || block_shape.z != 1 || block_shape.x == 0 || block_shape.x > 1024)
    stop("only blocks with one dimension and at most 1024 threads are supported");
  if (grid.y > 65535 || grid.z > 65535) stop("the grid exceeds the limits of CUDA");
  static std::vector<std::unique_ptr<char[]>> stacks;
  while (stacks.size() < block_shape.x) stacks.emplace_back(new char[kStackBytes]);
  grid_size = grid;
  block_size = block_shape;
  block.kernel = &kernel;
  block.fibres.resize(block_shape.x);
  block.order = make_order(block_shape.x, 0);
  block.place.resize(block_shape.x);
  for (unsigned i = 0; i < block_shape.x; ++i) block.place[block.order[i]] = i;
  for (const unsigned x : make_order(grid.x, 1))
    for (unsigned y = 0; y < grid.y; ++y)
      for (unsigned z = 0; z < grid.z; ++z) {
        block_position = {x, y, z};
        run_block(stacks);
      }
}

}  // namespace cuda_on_host
