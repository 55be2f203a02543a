// SPDX-License-Identifier: Apache-2.0
// A small HTTP and WebSocket server in a thread of its own. Visitors get a page at /, figures at /state, and
// at /live pictures from the cameras that they send. It knows nothing of models: whoever owns it asks for the
// next wish and hands the picture in. What visitors send is read with limits on its size and never written
// anywhere.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "host/scene/camera.hpp"

namespace ubs::serve {

struct Address {
  std::string host = "127.0.0.1";  // a name or an address of this machine
  int port = 8080;                 // 0: a free one
};

inline constexpr int kMaxPixels = 1 << 21;  // of a picture

struct Wish {
  std::uint64_t visitor = 0;
  std::int64_t id = 0;  // the visitor's own number for it
  Camera camera;        // checked
  bool exact = false;   // as PNG
};

class Server {
 public:
  // Takes the port; throws Error(usage) where it cannot. Nobody is answered before start().
  explicit Server(const Address& address);
  ~Server();  // after what is on its way has been sent, within a second
  Server(const Server&) = delete;

  // For a browser on this machine, or with the token that is needed where others reach the address.
  const std::string& url() const;
  // `cpu_share`: of the machine's processors, that answering may take on average.
  void start(std::string page, double cpu_share);
  void publish(std::string state);  // JSON, for /state
  // The next visitor's in turn, the newest of each, if `take` says so; waits so long for one.
  std::optional<Wish> next(std::chrono::milliseconds wait = {},
                           const std::function<bool(const Wish&)>& take = {});
  // `header`: JSON. A visitor who reads slowly has asked for nothing else meanwhile: no pictures queue up.
  void answer(const Wish& wish, const std::string& header, const std::string& picture);
  void ask_again();  // as if all visitors had asked for their last picture once more

 private:
  struct Implementation;
  std::unique_ptr<Implementation> own_;
};

}  // namespace ubs::serve
