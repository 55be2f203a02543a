// SPDX-License-Identifier: Apache-2.0
#include "host/look/serve/http.hpp"

#include <fcntl.h>
#include <httplib.h>
#include <poll.h>
#include <strings.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"

namespace ubs::serve {
namespace {

constexpr std::size_t kMaxHead = 8192, kMaxBody = 4096, kMaxDrained = 65536, kMaxLine = 300;
constexpr double kRequestSeconds = 5, kAnswerSeconds = 20, kDrainSeconds = 1;

// LimitedStream is a connection in the form of a stream of cpp-httplib. It limits the bytes and the time of a
// request, and the time of its answer.
class LimitedStream final : public httplib::Stream {
 public:
  LimitedStream(int descriptor, const std::function<void()>& admitted)
      : descriptor_(descriptor), admitted_(admitted) {}

  int descriptor() const { return descriptor_; }
  void admit() const { admitted_(); }

  // Reads until the empty line after the headers. Returns false if this line does not arrive within the
  // limits.
  bool read_head() {
    for (std::size_t searched = 0;;) {
      const std::size_t end = data_.find("\r\n\r\n", searched);
      if (end != std::string::npos) return end <= kMaxHead && (hide_ranges(end), true);
      searched = data_.size() - std::min<std::size_t>(data_.size(), 3);
      if (data_.size() > kMaxHead || !receive()) return false;
    }
  }

  // Ends the connection so that the client can still read the answer. For this, unread bytes of the client
  // are read first, because closing the socket while there are unread bytes would reset the connection.
  void finish() const {
    ::shutdown(descriptor_, SHUT_WR);
    const Stopwatch watch;
    char rest[4096];
    for (std::size_t drained = 0; drained < kMaxDrained;) {
      if (!wait(POLLIN, kDrainSeconds - watch.seconds())) return;
      const ssize_t count = ::recv(descriptor_, rest, sizeof rest, MSG_DONTWAIT);
      if (count <= 0) return;
      drained += static_cast<std::size_t>(count);
    }
  }

  ssize_t read(char* to, std::size_t size) override {
    if (used_ == data_.size() && !receive()) return -1;
    const std::size_t count = std::min(size, data_.size() - used_);
    std::memcpy(to, data_.data() + used_, count);
    used_ += count;
    return static_cast<ssize_t>(count);
  }

  ssize_t write(const char* from, std::size_t size) override {
    if (!answering_) answering_.emplace();
    if (!wait(POLLOUT, kAnswerSeconds - answering_->seconds())) return -1;
    const ssize_t count = ::send(descriptor_, from, size, MSG_NOSIGNAL | MSG_DONTWAIT);
    return count < 0 && errno == EAGAIN ? 0 : count;
  }

  bool is_readable() const override { return true; }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  // Returns -1 instead of the descriptor. The library rejects descriptors that are too large for select(),
  // but this class does not use select().
  socket_t socket() const override { return -1; }
  // The next functions are not marked `override`, because versions of the library before 0.18 have only the
  // first of them, and later versions have only the others.
  bool is_writable() const { return true; }
  bool wait_readable() const { return true; }
  bool wait_writable() const { return true; }
  time_t duration() const { return 0; }

 private:
  bool wait(short events, double seconds) const {
    if (!(seconds > 0)) return false;
    pollfd one{.fd = descriptor_, .events = events, .revents = 0};
    return ::poll(&one, 1, static_cast<int>(std::ceil(1000 * seconds))) > 0;
  }

  // Receives bytes and appends them. Returns false at the end of the connection and at the limits.
  bool receive() {
    char bytes[4096];
    const std::size_t room = std::min(sizeof bytes, kMaxHead + kMaxBody - data_.size());
    if (room == 0 || !wait(POLLIN, kRequestSeconds - reading_.seconds())) return false;
    const ssize_t count = ::recv(descriptor_, bytes, room, MSG_DONTWAIT);
    if (count <= 0) return false;
    data_.append(bytes, static_cast<std::size_t>(count));
    return true;
  }

  // Renames headers whose names begin with "Range". The library matches their values with a regular
  // expression that needs up to 0.5 KB of stack per byte, so a long value would overflow the stack and end
  // the process (in cpp-httplib 0.11.4, 8000 bytes need 4 MB).
  void hide_ranges(std::size_t end) {
    for (std::size_t line = data_.find('\n'); line < end; line = data_.find('\n', line + 1))
      if (strncasecmp(data_.data() + line + 1, "range", 5) == 0) data_[line + 1] = 'X';
  }

  int descriptor_;
  const std::function<void()>& admitted_;
  Stopwatch reading_;
  std::optional<Stopwatch> answering_;
  std::string data_;
  std::size_t used_ = 0;
};

// The connection that this thread answers. Handlers read it from here, because the library does not pass it.
thread_local const LimitedStream* this_connection = nullptr;

bool peer_gone(int socket) {
  pollfd one{.fd = socket, .events = POLLRDHUP, .revents = 0};
  return ::poll(&one, 1, 0) > 0;
}

// Compares two tokens in a time that does not depend on the position of the first difference.
bool same_token(std::string_view given, std::string_view token) {
  unsigned different = given.size() == token.size() ? 0 : 1;
  for (std::size_t i = 0; i < token.size(); ++i)
    different |= static_cast<unsigned char>(token[i] ^ (i < given.size() ? given[i] : 0));
  return different == 0;
}

std::string_view without_port(std::string_view host) {
  return host.starts_with('[') ? host.substr(0, host.find(']') + 1) : host.substr(0, host.find(':'));
}

void set_line(httplib::Response& response, int status, std::string line) {
  line.resize(std::min(line.size(), kMaxLine));
  std::replace_if(
      line.begin(), line.end(), [](unsigned char c) { return c < ' '; }, ' ');
  response.status = status;
  response.set_content(line + "\n", "text/plain");
}

struct Refusal {
  int status;
  const char* why;
};

std::optional<Refusal> refusal(const Site& site, const httplib::Request& request) {
  const std::string host = request.get_header_value("Host"), origin = request.get_header_value("Origin");
  const std::string_view name = without_port(host);
  // On loopback, the Host header must be a name of this machine, so that a web page of another name cannot
  // send requests (DNS rebinding). If other machines can connect, requests need the token instead, which such
  // a page does not know.
  if (site.loopback && name != "localhost" && name != "127.0.0.1" && name != "[::1]" && name != site.host)
    return Refusal{421, "wrong Host header for this server"};
  if (!site.token.empty() && !same_token(request.get_param_value("token"), site.token))
    return Refusal{403, "missing or wrong token: open the complete address that ubs printed"};
  if (request.has_header("Origin") && origin != "http://" + host)
    return Refusal{403, "only the page of this server may send this request"};
  // Browsers send no header Origin with an image or a frame of another page. A link to this page is allowed.
  const std::string from = request.get_header_value("Sec-Fetch-Site");
  const bool follows_link = request.get_header_value("Sec-Fetch-Mode") == "navigate" &&
                            request.get_header_value("Sec-Fetch-Dest") == "document";
  if (!from.empty() && from != "same-origin" && from != "none" && !(follows_link && request.path == "/"))
    return Refusal{403, "only the page of this server may send this request"};
  if (request.method != "GET" && request.method != "POST")
    return Refusal{405, "only GET and POST are supported"};
  // Accept only JSON bodies with a length, because the library might decompress other bodies or split them.
  if (request.has_header("Transfer-Encoding") || request.has_header("Content-Encoding"))
    return Refusal{415, "the body must have a Content-Length and no encoding"};
  if (request.method == "GET") return {};
  if (request.get_header_value("Content-Type") != "application/json")
    return Refusal{415, "the body must be application/json"};
  const std::string length = request.get_header_value("Content-Length");
  if (length.empty() || length.find_first_not_of("0123456789") != std::string::npos)
    return Refusal{411, "the body must have a Content-Length"};
  if (length.size() > 4 || std::stoul(length) > kMaxBody) return Refusal{413, "the body is too long"};
  return {};
}

}  // namespace

class Http::Library final : public httplib::Server {
 public:
  explicit Library(Site site) : site_(std::move(site)) {
    set_default_headers({{"Cache-Control", "no-store"},
                         {"Referrer-Policy", "no-referrer"},  // the address may contain the token
                         {"X-Content-Type-Options", "nosniff"},
                         {"X-Frame-Options", "DENY"},
                         {"Cross-Origin-Resource-Policy", "same-origin"}});
    set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      const std::optional<Refusal> refused = refusal(site_, request);
      if (refused) set_line(response, refused->status, refused->why);
      return refused ? HandlerResponse::Handled : HandlerResponse::Unhandled;
    });
    // The library calls handlers after it has read the body. Only then a request is complete, so a client
    // that sends its body slowly does not keep the place of others.
    Get("/", [this](const httplib::Request&, httplib::Response& response) {
      this_connection->admit();
      response.set_content(site_.page, "text/html; charset=utf-8");
    });
    Get("/state", [this](const httplib::Request&, httplib::Response& response) {
      this_connection->admit();
      response.set_content(site_.state(), "application/json");
    });
    Post("/picture", [this](const httplib::Request& request, httplib::Response& response) {
      this_connection->admit();
      const int socket = this_connection->descriptor();
      HttpReply reply = site_.picture(request.body, [socket] { return peer_gone(socket); });
      if (reply.status != 200) return set_line(response, reply.status, reply.body);
      for (const auto& [name, value] : reply.headers) response.set_header(name, value);
      response.body = std::move(reply.body);
      response.set_header("Content-Type", reply.type);
    });
    set_exception_handler(
        [](const httplib::Request&, httplib::Response& response, std::exception_ptr thrown) {
          try {
            std::rethrow_exception(thrown);
          } catch (const Error& error) {
            set_line(response, error.kind() == ErrorKind::data ? 400 : 500, error.what());
          } catch (const std::exception& error) {
            set_line(response, 500, error.what());
          } catch (...) {
            set_line(response, 500, "unknown error");
          }
        });
    set_error_handler([](const httplib::Request&, httplib::Response& response) {
      if (!response.body.empty()) return;
      set_line(response, response.status,
               response.status == 404 ? "unknown path: expected /, /state or /picture"
                                      : "method not supported by this server");
    });
  }

  void answer(LimitedStream& stream) {
    call(&Library::process_request, stream, [](httplib::Request& request) {
      // Compression would take more time than it saves on loopback and in tunnels.
      request.headers.erase("Accept-Encoding");
    });
  }

 private:
  using Setup = std::function<void(httplib::Request&)>;
  // process_request() has the first of these signatures up to version 0.17 of the library, and the second
  // since version 0.18.
  using Process = bool (httplib::Server::*)(httplib::Stream&, bool, bool&, const Setup&);
  using AddressedProcess = bool (httplib::Server::*)(httplib::Stream&, const std::string&, int,
                                                     const std::string&, int, bool, bool&, const Setup&);

  void call(Process process, LimitedStream& stream, const Setup& setup) {
    bool closed = false;
    (this->*process)(stream, true, closed, setup);
  }
  void call(AddressedProcess process, LimitedStream& stream, const Setup& setup) {
    bool closed = false;
    (this->*process)(stream, "", 0, "", 0, true, closed, setup);
  }

  const Site site_;
};

Http::Http(Site site) : library_(std::make_unique<Library>(std::move(site))) {}
Http::~Http() = default;

void Http::answer(int socket, const std::function<void()>& admitted) noexcept {
  try {
    LimitedStream stream(socket, admitted);
    if (!stream.read_head()) return;
    this_connection = &stream;
    library_->answer(stream);
    stream.finish();
    // If memory runs out outside of the handlers, the connection ends without an answer.
  } catch (...) {
  }
  this_connection = nullptr;
}

}  // namespace ubs::serve
