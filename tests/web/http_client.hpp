// SPDX-License-Identifier: Apache-2.0
// Client is an HTTP client for tests of the server. It can send arbitrary bytes.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <string>
#include <utility>

#include "host/look/serve/server.hpp"
#include "host/scene/camera_json.hpp"

namespace ubs::serve {

struct Answer {
  int status = 0;  // 0: the connection ended without an answer
  std::string head, body;
};

class Client {
 public:
  explicit Client(const Server& server) : Client(::socket(AF_INET, SOCK_STREAM, 0), server) {}
  // Takes an unconnected socket. The connection then needs no further descriptor in this process.
  Client(int socket, const Server& server) : socket_(socket) {
    const std::string& url = server.url();
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    place.sin_port = htons(static_cast<in_port_t>(std::stoi(url.substr(url.rfind(':') + 1))));
    const timeval patience{.tv_sec = 600, .tv_usec = 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    REQUIRE(::connect(socket_, reinterpret_cast<sockaddr*>(&place), sizeof place) == 0);
  }
  Client(Client&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
  ~Client() {
    if (socket_ >= 0) ::close(socket_);
  }

  // Returns false if the server has closed the connection.
  bool send(const std::string& text) const {
    return ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
  }
  std::string all() const {
    std::string text;
    char bytes[4096];
    for (ssize_t count; (count = ::recv(socket_, bytes, sizeof bytes, 0)) > 0;)
      text.append(bytes, static_cast<std::size_t>(count));
    return text;
  }
  Answer answer() const {
    const std::string text = all();
    const std::size_t end = text.find("\r\n\r\n");
    if (end == std::string::npos) return {};
    return {std::stoi(text.substr(9)), text.substr(0, end), text.substr(end + 4)};
  }

 private:
  int socket_;
};

inline std::string get(const std::string& target, const std::string& more = "Host: localhost\r\n") {
  return "GET " + target + " HTTP/1.1\r\n" + more + "\r\n";
}

inline std::string post(const std::string& body,
                        const std::string& more = "Content-Type: application/json\r\n") {
  return "POST /picture HTTP/1.1\r\nHost: localhost\r\n" + more +
         "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
}

inline Answer answer_of(const Server& server, const std::string& request) {
  const Client client(server);
  client.send(request);
  return client.answer();
}

inline Json request_json() {
  return {{"camera", camera_json({.fx = 8, .fy = 8, .cx = 4, .cy = 4, .width = 8, .height = 8})}};
}

}  // namespace ubs::serve
