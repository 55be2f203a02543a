// SPDX-License-Identifier: Apache-2.0
// Server shows a page, figures and pictures to browsers, from threads of its own. It knows nothing of models:
// its owner calls serve(), which has the oldest request for a picture drawn in the calling thread. The limits
// on connections, bytes and times, and who may ask, are described in SECURITY.md.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs::serve {

struct Address {
  std::string host = "127.0.0.1";  // a name or an address of this machine
  int port = 8080;                 // 0: a free one
};

inline constexpr int kMaxPicturePixels = 1 << 21, kMaxPictureSide = 1 << 14;

struct PictureRequest {
  Camera camera;       // checked
  bool exact = false;  // as PNG
};

struct Picture {
  std::string bytes;                                         // of the JPEG or PNG file
  std::vector<std::pair<std::string, std::string>> headers;  // of the answer
};

class Server {
 public:
  // Takes the port. Throws Error(usage) if the port is taken or the host is not of this machine.
  explicit Server(const Address& address);
  // Gives answers that are being sent one second, and tells those who wait for a picture that it has ended.
  ~Server();
  Server(const Server&) = delete;

  // Returns the address for browsers. It has the token that is required where other machines can connect.
  const std::string& url() const;
  void start(std::string page);     // begins to answer
  void publish(std::string state);  // JSON, for /state

  using Draw = std::function<Picture(const PictureRequest&)>;
  // Waits up to `wait` for a request, has `draw` answer the oldest, and returns whether there was one. An
  // exception of `draw`, of whatever type, becomes the answer to the request and goes no further.
  bool serve(std::chrono::milliseconds wait, const Draw& draw);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> own_;
};

}  // namespace ubs::serve
