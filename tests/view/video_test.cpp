// SPDX-License-Identifier: Apache-2.0
// Tests writing and reading of videos: the number of frames, their order, that each frame is similar to the
// image that was written, and errors. Colours are tested against the formulas of the standards, with the
// values that libavcodec stores in frames.
#include "host/dataset/video.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/pixdesc.h>
}

#include "host/dataset/video_writer.hpp"
#include "tests/support/images.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using Catch::Contains;
using test::TempFolder;

namespace {

constexpr int kFrames = 7, kShift = 20;

std::vector<Image8> read_back(const std::filesystem::path& path) {
  const auto video = open_video(path);
  const ImageSize size = video_size(*video);
  std::vector<Image8> frames;
  for (int i = 0; i < video_frames(*video); ++i)
    frames.push_back(video_frame_source(video, i, size.width, size.height)->load());
  return frames;
}

void write(const std::filesystem::path& path) {
  VideoWriter writer(path, 96, 64, 24);
  for (int i = 0; i < kFrames; ++i) writer.write(test::gradient_image(96, 64, kShift * i));
  CHECK(!std::filesystem::exists(path));
  writer.commit();
}

void require(int code) {
  if (code >= 0) return;
  char text[AV_ERROR_MAX_STRING_SIZE] = "";
  av_strerror(code, text, sizeof text);
  FAIL(text);
}

// Encoding describes how the colours of a video are encoded.
struct Encoding {
  AVPixelFormat format = AV_PIX_FMT_YUV420P;
  AVColorSpace matrix = AVCOL_SPC_UNSPECIFIED;
  AVColorRange range = AVCOL_RANGE_UNSPECIFIED;
};
struct Weights {
  double red, blue;
};
constexpr Weights k601{0.299, 0.114}, k709{0.2126, 0.0722}, k2020{0.2627, 0.0593};

struct Colour {
  double red, green, blue;
};
constexpr Colour kColours[] = {{220, 30, 30}, {30, 200, 40}, {30, 40, 220}, {200, 200, 30}};

// Returns Y, Cb and Cr (ITU-R BT.601, BT.709, BT.2020) of a colour with values from 0 to 255.
std::array<double, 3> encoded(const Colour& c, const Weights& w, bool full, int bits) {
  const double luma = (w.red * c.red + (1 - w.red - w.blue) * c.green + w.blue * c.blue) / 255;
  const double cb = (c.blue / 255 - luma) / (2 - 2 * w.blue), cr = (c.red / 255 - luma) / (2 - 2 * w.red);
  const double step = 1 << (bits - 8), top = (1 << bits) - 1;
  if (full) return {top * luma, top * cb + 128 * step, top * cr + 128 * step};
  return {step * (16 + 219 * luma), step * (128 + 224 * cb), step * (128 + 224 * cr)};
}

// Writes a video: MP4 with MPEG-4, and Matroska without loss (FFV1). It has one frame, in which column k of
// four shows kColours[k]. `turn` is a number of degrees, which the file states.
void put_video(const std::filesystem::path& path, const Encoding& encoding, const Weights& weights, bool full,
               int width, int height, int turn = 0) {
  AVFormatContext* format = nullptr;
  require(avformat_alloc_output_context2(&format, nullptr, nullptr, path.c_str()));
  const std::unique_ptr<AVFormatContext, void (*)(AVFormatContext*)> own(format, avformat_free_context);
  const bool mp4 = path.extension() == ".mp4";
  const AVCodec* codec = avcodec_find_encoder(mp4 ? AV_CODEC_ID_MPEG4 : AV_CODEC_ID_FFV1);
  AVCodecContext* c = avcodec_alloc_context3(codec);
  c->width = width, c->height = height, c->time_base = {1, 25}, c->pix_fmt = encoding.format;
  if (mp4)
    c->flags |= AV_CODEC_FLAG_QSCALE | AV_CODEC_FLAG_GLOBAL_HEADER, c->global_quality = 2 * FF_QP2LAMBDA;
  c->colorspace = encoding.matrix, c->color_range = encoding.range;
  require(avcodec_open2(c, codec, nullptr));
  AVStream* stream = avformat_new_stream(format, nullptr);
  require(avcodec_parameters_from_context(stream->codecpar, c));
  stream->time_base = c->time_base;
  if (turn != 0) {
    auto* matrix = reinterpret_cast<std::int32_t*>(
        av_stream_new_side_data(stream, AV_PKT_DATA_DISPLAYMATRIX, 9 * sizeof(std::int32_t)));
    av_display_rotation_set(matrix, turn);
  }
  require(avio_open(&format->pb, path.c_str(), AVIO_FLAG_WRITE));
  require(avformat_write_header(format, nullptr));
  AVFrame* frame = av_frame_alloc();
  frame->format = encoding.format, frame->width = width, frame->height = height;
  require(av_frame_get_buffer(frame, 0));
  const AVPixFmtDescriptor* layout = av_pix_fmt_desc_get(encoding.format);
  const int bits = layout->comp[0].depth;
  for (int plane = 0; plane < 3; ++plane) {
    const int across = plane ? width >> layout->log2_chroma_w : width;
    const int down = plane ? height >> layout->log2_chroma_h : height;
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x) {
        const auto value = static_cast<std::uint16_t>(std::lround(
            encoded(kColours[4 * x / across], weights, full, bits)[static_cast<std::size_t>(plane)]));
        std::uint8_t* row = frame->data[plane] + std::ptrdiff_t{y} * frame->linesize[plane];
        if (bits == 8)
          row[x] = static_cast<std::uint8_t>(value);
        else
          reinterpret_cast<std::uint16_t*>(row)[x] = value;
      }
  }
  AVPacket* packet = av_packet_alloc();
  for (const AVFrame* next : {static_cast<const AVFrame*>(frame), static_cast<const AVFrame*>(nullptr)}) {
    frame->pts = 0, frame->quality = c->global_quality;
    require(avcodec_send_frame(c, next));
    while (avcodec_receive_packet(c, packet) == 0) {
      packet->duration = 1;
      av_packet_rescale_ts(packet, c->time_base, stream->time_base);
      require(av_interleaved_write_frame(format, packet));
    }
  }
  require(av_write_trailer(format));
  avio_closep(&format->pb);
  av_packet_free(&packet), av_frame_free(&frame), avcodec_free_context(&c);
}

// StoredFrame holds what libavcodec says about the first frame of a file, and its Y, Cb and Cr at the centre
// of each quarter of its width.
struct StoredFrame {
  double fps = 0;
  AVColorSpace matrix = AVCOL_SPC_UNSPECIFIED;
  AVColorRange range = AVCOL_RANGE_UNSPECIFIED;
  AVColorPrimaries primaries = AVCOL_PRI_UNSPECIFIED;
  std::vector<std::array<double, 3>> values;
};

StoredFrame first_frame(const std::filesystem::path& path) {
  AVFormatContext* format = nullptr;
  require(avformat_open_input(&format, path.c_str(), nullptr, nullptr));
  require(avformat_find_stream_info(format, nullptr));
  const AVStream* stream = format->streams[0];
  AVCodecContext* c = avcodec_alloc_context3(avcodec_find_decoder(stream->codecpar->codec_id));
  require(avcodec_parameters_to_context(c, stream->codecpar));
  require(avcodec_open2(c, nullptr, nullptr));
  AVPacket* packet = av_packet_alloc();
  AVFrame* frame = av_frame_alloc();
  while (avcodec_receive_frame(c, frame) != 0) {
    const bool more = av_read_frame(format, packet) == 0;
    require(avcodec_send_packet(c, more ? packet : nullptr));
    av_packet_unref(packet);
  }
  StoredFrame found{
      av_q2d(stream->avg_frame_rate), frame->colorspace, frame->color_range, frame->color_primaries, {}};
  for (int k = 0; k < 4; ++k) {
    const int x = (2 * k + 1) * frame->width / 8, y = frame->height / 2;
    const auto at = [&](int plane, int shift) {
      return static_cast<double>(
          frame->data[plane][std::ptrdiff_t{y >> shift} * frame->linesize[plane] + (x >> shift)]);
    };
    found.values.push_back({at(0, 0), at(1, 1), at(2, 1)});  // 4:2:0
  }
  av_frame_free(&frame), av_packet_free(&packet), avcodec_free_context(&c), avformat_close_input(&format);
  return found;
}

}  // namespace

TEST_CASE("video: every supported format contains the frames in order") {
  const std::string possible = writable_videos();
  INFO(possible);
  CHECK_THAT(possible, Contains(".avi (MJPG)"));
  for (const std::string& extension : video_extensions()) {
    if (possible.find(extension + " ") == std::string::npos) {
      WARN("SKIPPED: no encoder for " << extension);
      continue;
    }
    INFO(extension);
    const TempFolder folder;
    write(folder / ("v" + extension));
    CHECK(test::file_count(folder.path()) == 1);
    const std::vector<Image8> frames = read_back(folder / ("v" + extension));
    CHECK(first_frame(folder / ("v" + extension)).fps == Approx(24).epsilon(1e-3));
    REQUIRE(frames.size() == kFrames);
    for (int i = 0; i < kFrames; ++i) {
      // The observed errors are 3.1 for H.264 and 1.7 for Motion JPEG. Consecutive frames differ by at least
      // 18.8.
      CHECK(test::image_difference(frames[static_cast<std::size_t>(i)],
                                   test::gradient_image(96, 64, kShift * i)) < 6);
      CHECK(test::image_difference(frames[static_cast<std::size_t>(i)],
                                   test::gradient_image(96, 64, kShift * (i + 1))) > 12);
    }
  }
}

TEST_CASE("video: .AVI is treated like .avi") {
  const TempFolder folder;
  write(folder / "V.AVI");
  CHECK(read_back(folder / "V.AVI").size() == kFrames);
}

TEST_CASE("video: searching for supported formats does not overwrite files of other users") {
  const TempFolder folder;
  const test::Variable temporary("TMPDIR", folder.path().c_str());
  test::put(folder / "precious", "precious");
  // writable_videos() writes a small video. If its name were predictable, another user could create a link
  // with this name, and the target of the link would be overwritten.
  std::filesystem::create_symlink(folder / "precious", folder / fmt::format("ubs-codec-{}.avi", ::getpid()));
  CHECK_THAT(writable_videos(), Contains(".avi (MJPG)"));
  CHECK(test::get(folder / "precious") == "precious");
  CHECK(test::file_count(folder.path()) == 2);
}

TEST_CASE("video: an unfinished video leaves no file") {
  const TempFolder folder;
  {
    VideoWriter writer(folder / "v.avi", 64, 64, 10);
    writer.write(test::gradient_image(64, 64));
  }
  CHECK(test::file_count(folder.path()) == 0);
  {
    VideoWriter writer(folder / "none.avi", 64, 64, 10);
    CHECK_THAT(test::message_of([&] { writer.commit(); }, ErrorKind::internal),
               Contains("at least one frame"));
  }
  CHECK(test::file_count(folder.path()) == 0);
}

// A limit for the size of files simulates a full disk.
TEST_CASE("video: a video that could not be written completely is an error, and leaves no file") {
  const TempFolder folder;
  const auto write_noise = [&] {
    VideoWriter writer(folder / "v.avi", 96, 64, 10);
    Image8 noise{96, 64, std::vector<unsigned char>(std::size_t{3} * 96 * 64)};
    std::uint32_t state = 1;
    for (int i = 0; i < 16; ++i) {
      for (unsigned char& value : noise.rgb) {
        state = state * 1664525u + 1013904223u;
        value = static_cast<unsigned char>(state >> 24);
      }
      writer.write(noise);
    }
    writer.commit();
  };
  write_noise();
  const auto bytes = std::filesystem::file_size(folder / "v.avi");
  std::filesystem::remove(folder / "v.avi");
  rlimit before{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const double share : {0.3, 0.6, 0.95}) {
    INFO(share);
    const rlimit limit{static_cast<rlim_t>(share * static_cast<double>(bytes)), before.rlim_max};
    REQUIRE(setrlimit(RLIMIT_FSIZE, &limit) == 0);
    const std::string message = test::message_of(write_noise);
    REQUIRE(setrlimit(RLIMIT_FSIZE, &before) == 0);
    CHECK_THAT(message, Contains("v.avi: ") && Contains("File too large"));
    CHECK(test::file_count(folder.path()) == 0);
  }
  std::signal(SIGXFSZ, handler);
}

TEST_CASE("video: a damaged frame gives an error at every attempt, and never a different frame") {
  const TempFolder folder;
  write(folder / "v.avi");
  std::string bytes = test::get(folder / "v.avi");
  std::size_t at = 0;
  for (int i = 0; i < 3; ++i) at = bytes.find("\xff\xd8\xff", at + 1);  // the start of frame 2
  REQUIRE(at != std::string::npos);
  const std::size_t length = bytes.find("00dc", at) - at;
  bytes.replace(at, length, length, '\0');
  test::put(folder / "v.avi", bytes);
  const auto video = open_video(folder / "v.avi");
  const auto load = [&](int index) { return video_frame_source(video, index, 96, 64)->load(); };
  CHECK(test::image_difference(load(1), test::gradient_image(96, 64, kShift)) < 6);
  for (int i = 0; i < 3; ++i)
    CHECK_THAT(test::message_of([&] { load(2); }), Contains("v.avi: cannot decode frame 2"));
  CHECK(test::image_difference(load(4), test::gradient_image(96, 64, 4 * kShift)) < 6);
  CHECK(test::image_difference(load(1), test::gradient_image(96, 64, kShift)) < 6);
}

TEST_CASE("video: names, sizes and rates that are not supported are rejected with a message") {
  const TempFolder folder;
  const auto refused = [&](const std::string& name, int width, double fps, ErrorKind kind) {
    return test::message_of([&] { VideoWriter(folder / name, width, 64, fps); }, kind);
  };
  CHECK_THAT(refused("v.gif", 64, 10, ErrorKind::usage),
             Contains("v.gif: the name of a video must end with one of .avi, "));
  CHECK_THAT(refused("v.avi", 63, 10, ErrorKind::usage),
             Contains("even width and height") && Contains("63x64"));
  CHECK_THAT(refused("v.avi", 64, 0, ErrorKind::usage), Contains("0 frames per second"));
  CHECK_THAT(refused("missing/v.avi", 64, 10, ErrorKind::data),
             Contains("missing: the folder does not exist"));
  test::put(folder / "d.avi/file", "");
  CHECK_THAT(refused("d.avi", 64, 10, ErrorKind::data), Contains("d.avi: this is a folder"));
  CHECK(test::file_count(folder.path()) == 1);
}

TEST_CASE("video: colours are read with the matrix and the range that the stream states") {
  struct Case {
    const char* name;
    Encoding encoding;
    Weights weights;
    bool full;
    int width, height;
  };
  // A stream without a matrix is decoded as players do: with BT.709 if it is HD.
  for (const Case& c : std::vector<Case>{
           {"BT.709", {AV_PIX_FMT_YUV420P, AVCOL_SPC_BT709, AVCOL_RANGE_MPEG}, k709, false, 64, 48},
           {"BT.709, full", {AV_PIX_FMT_YUV444P, AVCOL_SPC_BT709, AVCOL_RANGE_JPEG}, k709, true, 64, 48},
           {"BT.709, 10 bits",
            {AV_PIX_FMT_YUV420P10, AVCOL_SPC_BT709, AVCOL_RANGE_MPEG},
            k709,
            false,
            64,
            48},
           {"BT.709, 10 bits, full",
            {AV_PIX_FMT_YUV422P10, AVCOL_SPC_BT709, AVCOL_RANGE_JPEG},
            k709,
            true,
            64,
            48},
           {"BT.601", {AV_PIX_FMT_YUV420P, AVCOL_SPC_SMPTE170M, AVCOL_RANGE_MPEG}, k601, false, 64, 48},
           {"BT.601, HD", {AV_PIX_FMT_YUV420P, AVCOL_SPC_BT470BG, AVCOL_RANGE_MPEG}, k601, false, 1280, 64},
           {"BT.2020", {AV_PIX_FMT_YUV420P10, AVCOL_SPC_BT2020_NCL, AVCOL_RANGE_MPEG}, k2020, false, 64, 48},
           {"SD", {}, k601, false, 720, 64},
           {"HD by its width", {}, k709, false, 1280, 64},
           {"HD by its height", {}, k709, false, 64, 720}}) {
    INFO(c.name);
    const TempFolder folder;
    put_video(folder / "v.mkv", c.encoding, c.weights, c.full, c.width, c.height);
    const std::vector<Image8> frames = read_back(folder / "v.mkv");
    REQUIRE(frames.size() == 1);
    REQUIRE((frames[0].width == c.width && frames[0].height == c.height));
    for (int k = 0; k < 4; ++k) {
      INFO(k);
      const Colour& colour = kColours[k];
      const std::size_t at = 3 * (static_cast<std::size_t>(c.height / 2 * c.width) +
                                  static_cast<std::size_t>((2 * k + 1) * c.width / 8));
      CHECK(frames[0].rgb[at] == Approx(colour.red).margin(4));
      CHECK(frames[0].rgb[at + 1] == Approx(colour.green).margin(4));
      CHECK(frames[0].rgb[at + 2] == Approx(colour.blue).margin(4));
    }
  }
}

TEST_CASE("video: a colour matrix that cannot be converted is an error with its name") {
  const TempFolder folder;
  put_video(folder / "v.mkv", {AV_PIX_FMT_YUV420P, AVCOL_SPC_YCGCO, AVCOL_RANGE_MPEG}, k709, false, 64, 48);
  CHECK_THAT(test::message_of([&] { read_back(folder / "v.mkv"); }),
             Contains("v.mkv: cannot decode frame 0: the colour matrix 'ycgco' is not supported"));
}

TEST_CASE("video: written files state their colours, which follow the formulas of the standards") {
  for (const int width : {64, 1280})
    for (const std::string& extension : video_extensions()) {
      if (writable_videos().find(extension + " ") == std::string::npos) continue;
      INFO(width << " " << extension);
      const TempFolder folder;
      Image8 image{width, 48, {}};
      for (int i = 0; i < width * 48; ++i)
        for (const double v : {kColours[i % width * 4 / width].red, kColours[i % width * 4 / width].green,
                               kColours[i % width * 4 / width].blue})
          image.rgb.push_back(static_cast<std::uint8_t>(v));
      {
        VideoWriter writer(folder / ("v" + extension), width, 48, 25);
        for (int i = 0; i < 3; ++i) writer.write(image);
        writer.commit();
      }
      const StoredFrame found = first_frame(folder / ("v" + extension));
      const bool jpeg = extension == ".avi", hd = width == 1280;
      CHECK(found.matrix == (jpeg ? AVCOL_SPC_BT470BG : hd ? AVCOL_SPC_BT709 : AVCOL_SPC_SMPTE170M));
      CHECK(found.range == (jpeg ? AVCOL_RANGE_JPEG : AVCOL_RANGE_MPEG));
      if (!jpeg) CHECK(found.primaries == AVCOL_PRI_BT709);
      for (std::size_t k = 0; k < 4; ++k) {
        const std::array<double, 3> wanted = encoded(kColours[k], hd && !jpeg ? k709 : k601, jpeg, 8);
        for (std::size_t plane = 0; plane < 3; ++plane) {
          INFO(k << " " << plane);
          CHECK(found.values[k][plane] == Approx(wanted[plane]).margin(3));
        }
      }
      const Image8 read = read_back(folder / ("v" + extension)).front();
      CHECK(test::image_difference(read, image) < 8);
    }
}

TEST_CASE("video: frames are turned as the file states") {
  for (const int turn : {90, 180, -90}) {
    INFO(turn);
    const TempFolder folder;
    put_video(folder / "v.mp4", {}, k601, false, 64, 48, turn);
    const Image8 image = read_back(folder / "v.mp4").front();
    REQUIRE((image.width == (turn == 180 ? 64 : 48) && image.height == (turn == 180 ? 48 : 64)));
    // The angle is clockwise, so the red column at the left is at the top after 90 degrees.
    const int x = turn == 180 ? 60 : 24, y = turn == 180 ? 24 : turn == 90 ? 3 : 60;
    const std::size_t at = 3 * static_cast<std::size_t>(y * image.width + x);
    CHECK(image.rgb[at] == Approx(220).margin(8));
    CHECK(image.rgb[at + 1] == Approx(30).margin(8));
  }
}
