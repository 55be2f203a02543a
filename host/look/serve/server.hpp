// SPDX-License-Identifier: Apache-2.0
// Server sends a page, status data and images to browsers, using threads of its own. It does not depend on
// models: its owner calls serve(), which renders the image for the oldest request in the calling thread.
// SECURITY.md describes the limits on connections, bytes and times, and which clients are allowed.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs::serve {

struct Address {
  std::string host = "127.0.0.1";  // a name or address of this machine
  int port = 8080;                 // 0: any free port
};

// Maximum number of pixels and maximum length of a side of an image that a client may request.
inline constexpr int kMaxPicturePixels = 1 << 21, kMaxPictureSide = 1 << 14;

struct PictureRequest {
  Camera camera;       // accepted by check_camera()
  bool exact = false;  // true: send the image as PNG; false: as JPEG
};

struct Picture {
  std::string bytes;                                         // content of the JPEG or PNG file
  std::vector<std::pair<std::string, std::string>> headers;  // headers of the answer
};

class Server {
 public:
  // Opens the port. Throws Error(usage) if it cannot listen on the port, for example because the port is in
  // use or because the host is not this machine.
  explicit Server(const Address& address);
  // Allows one second to finish sending answers, and tells clients that wait for an image that the server has
  // ended.
  ~Server();
  Server(const Server&) = delete;

  // Returns the address for browsers. It contains the token if other machines can connect.
  const std::string& url() const;
  // Returns the number of allowed requests that have arrived so far.
  std::uint64_t requests() const;
  void start(std::string page);     // starts to answer requests; `page` is the HTML page
  void publish(std::string state);  // sets the JSON that answers requests for /state

  using Draw = std::function<Picture(const PictureRequest&)>;
  // Waits up to `wait` for a request for an image, answers the oldest one with `draw`, and returns whether
  // there was a request. If `draw` throws an exception of any type, it becomes the answer to the request and
  // is not passed on.
  bool serve(std::chrono::milliseconds wait, const Draw& draw);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> own_;
};

}  // namespace ubs::serve
