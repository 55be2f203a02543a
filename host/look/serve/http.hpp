// SPDX-License-Identifier: Apache-2.0
// Http reads one HTTP request from a connected socket, decides whether its sender may ask, and answers it.
// The library cpp-httplib parses requests and writes answers. What it does not limit is limited here: the
// bytes and the seconds of a request, the seconds of an answer, and exceptions, none of which leave answer().
// One connection carries one request, so nothing can be queued behind a request or hidden in its body.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace ubs::serve {

struct HttpReply {
  int status = 200;
  std::string type = "text/plain", body;
  std::vector<std::pair<std::string, std::string>> headers;
};

// What is served, and to whom.
struct Site {
  std::string host;                    // the name or address that the server was asked to listen at
  bool loopback = true;                // only programs on this machine can connect
  std::string token;                   // that requests must have in their address; empty: none is needed
  std::string page;                    // HTML, for GET /
  std::function<std::string()> state;  // returns JSON, for GET /state
  // Answers POST /picture, whose body is passed. `gone` returns true when the sender has closed the
  // connection.
  std::function<HttpReply(const std::string& body, const std::function<bool()>& gone)> picture;
};

class Http {
 public:
  explicit Http(Site site);
  ~Http();

  // Answers one request. Calls `admitted` when all headers have come and the request is allowed. Leaves the
  // socket open. May be called from several threads at once.
  void answer(int socket, const std::function<void()>& admitted) noexcept;

 private:
  class Library;
  std::unique_ptr<Library> library_;
};

}  // namespace ubs::serve
