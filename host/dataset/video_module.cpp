// SPDX-License-Identifier: Apache-2.0
// See video_codec.hpp.
#include "host/dataset/video_module.hpp"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/imgutils.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace ubs {
namespace {

struct Free {
  void operator()(AVFormatContext* p) const { avformat_close_input(&p); }
  void operator()(AVCodecContext* p) const { avcodec_free_context(&p); }
  void operator()(AVFrame* p) const { av_frame_free(&p); }
  void operator()(AVPacket* p) const { av_packet_free(&p); }
  void operator()(SwsContext* p) const { sws_freeContext(p); }
};
template <typename Object>
using Owned = std::unique_ptr<Object, Free>;

[[noreturn]] void failed(const std::string& what, int code) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  av_strerror(code, text.data(), text.size());
  throw std::runtime_error(what + ": " + text.data());
}
int check(int code, const char* what) {
  if (code < 0) failed(what, code);
  return code;
}
template <typename Object>
Object* made(Object* object) {
  if (object == nullptr) throw std::bad_alloc();
  return object;
}

// Returns the matrix that players assume if the stream states none.
AVColorSpace usual_matrix(int width, int height) {
  return width >= 1280 || height > 576 ? AVCOL_SPC_BT709 : AVCOL_SPC_SMPTE170M;
}

// Returns the coefficients of the conversion for libswscale.
const int* coefficients(AVColorSpace matrix) {
  switch (matrix) {
    case AVCOL_SPC_BT709:
    case AVCOL_SPC_FCC:
    case AVCOL_SPC_BT470BG:
    case AVCOL_SPC_SMPTE170M:
    case AVCOL_SPC_SMPTE240M:
    case AVCOL_SPC_BT2020_NCL:
      return sws_getCoefficients(matrix);
    default:
      break;
  }
  const char* name = av_color_space_name(matrix);
  throw std::runtime_error(std::string("the colour matrix '") + (name ? name : "unknown") +
                           "' is not supported: convert the video to BT.709");
}

// YUVJ formats are old names of full-range formats. libswscale warns about them.
AVPixelFormat without_range(AVPixelFormat format, bool& full) {
  switch (format) {
    case AV_PIX_FMT_YUVJ420P:
      full = true;
      return AV_PIX_FMT_YUV420P;
    case AV_PIX_FMT_YUVJ422P:
      full = true;
      return AV_PIX_FMT_YUV422P;
    case AV_PIX_FMT_YUVJ444P:
      full = true;
      return AV_PIX_FMT_YUV444P;
    case AV_PIX_FMT_YUVJ440P:
      full = true;
      return AV_PIX_FMT_YUV440P;
    case AV_PIX_FMT_YUVJ411P:
      full = true;
      return AV_PIX_FMT_YUV411P;
    default:
      return format;
  }
}

Owned<SwsContext> converter(int width, int height, AVPixelFormat from, AVPixelFormat to, AVColorSpace matrix,
                            bool full_from, bool full_to) {
  // With this flag, frames have the same values as with the program ffmpeg.
  Owned<SwsContext> scaler(
      made(sws_getContext(width, height, from, width, height, to, SWS_BICUBIC, nullptr, nullptr, nullptr)));
  const int* table = coefficients(matrix);
  sws_setColorspaceDetails(scaler.get(), table, full_from, table, full_to, 0, 1 << 16, 1 << 16);
  return scaler;
}

// Turn describes the quarter turns and reflections of a display matrix: whether columns become rows, and
// whether the axes of the shown image are reversed.
struct Turn {
  bool swap = false, reverse_x = false, reverse_y = false;
};

class LibavDecoder final : public VideoDecoder {
 public:
  explicit LibavDecoder(std::string path) : path_(std::move(path)) {
    open();
    list_frames();
    read_turn();
    look_at_colours();
    rewind();
  }

  int width() const override { return turn_.swap ? stored_height_ : stored_width_; }
  int height() const override { return turn_.swap ? stored_width_ : stored_height_; }
  int frames() const override { return static_cast<int>(shown_.size()); }
  const std::vector<std::string>& ignored() const override { return ignored_; }

  VideoPixels frame(int index) override {
    if (index < 0 || index >= frames()) throw std::runtime_error("the video has no such frame");
    try {
      find(index);
    } catch (...) {
      lost_ = true;
      throw;
    }
    return converted();
  }

 private:
  static constexpr int kDecodeAhead = 60;  // maximum number of frames that are decoded instead of seeking

  struct KeyFrame {
    std::int64_t pts = 0, dts = 0;
  };

  void open() {
    decoder_.reset();
    AVDictionary* options = nullptr;
    av_dict_set(&options, "protocol_whitelist", "file", 0);
    av_dict_set(&options, "format_whitelist", "avi,matroska,mov,mpegts,webm", 0);
    AVFormatContext* format = nullptr;
    const int code = avformat_open_input(&format, ("file:" + path_).c_str(), nullptr, &options);
    av_dict_free(&options);
    if (code < 0) failed("cannot open the video as AVI, Matroska, MOV, MP4, MPEG-TS or WebM", code);
    format_.reset(format);
    check(avformat_find_stream_info(format, nullptr), "cannot open the video");
    stream_ = av_find_best_stream(format, AVMEDIA_TYPE_VIDEO, -1, -1, nullptr, 0);
    check(stream_, "the file has no video");
    for (unsigned i = 0; i < format->nb_streams; ++i)
      if (static_cast<int>(i) != stream_) format->streams[i]->discard = AVDISCARD_ALL;
    const AVCodecParameters& parameters = *stream()->codecpar;
    const AVCodec* codec = avcodec_find_decoder(parameters.codec_id);
    if (codec == nullptr)
      throw std::runtime_error(std::string("no decoder for the codec '") +
                               avcodec_get_name(parameters.codec_id) + "'");
    decoder_.reset(made(avcodec_alloc_context3(codec)));
    check(avcodec_parameters_to_context(decoder_.get(), &parameters), "cannot open the video");
    decoder_->pkt_timebase = stream()->time_base;
    decoder_->thread_count = 0;  // as many threads as there are cores
    check(avcodec_open2(decoder_.get(), codec, nullptr), "cannot open the video");
    stored_width_ = parameters.width, stored_height_ = parameters.height;
    if (stored_width_ < 1 || stored_height_ < 1 || stored_width_ > 65535 || stored_height_ > 65535)
      throw std::runtime_error("the video has no frames");
  }

  AVStream* stream() const { return format_->streams[stream_]; }

  // Reads all packets, without decoding them, to know the number of frames and when each is shown.
  void list_frames() {
    while (next_packet()) {
      if ((packet_->flags & AV_PKT_FLAG_DISCARD) != 0) continue;  // left out by an edit list
      // AVI files only have decoding times, which are those of display if no frame is reordered.
      if (packet_->pts == AV_NOPTS_VALUE && stream()->codecpar->video_delay == 0) packet_->pts = packet_->dts;
      timed_ = timed_ && packet_->pts != AV_NOPTS_VALUE;
      shown_.push_back(packet_->pts);
      if ((packet_->flags & AV_PKT_FLAG_KEY) != 0)
        keys_.push_back({packet_->pts, packet_->dts != AV_NOPTS_VALUE ? packet_->dts : packet_->pts});
    }
    if (shown_.empty()) throw std::runtime_error("the video has no frames");
    std::ranges::sort(shown_);
    // Without times, or if two frames have the same one, frames are counted from the start of the file.
    timed_ = timed_ && std::ranges::adjacent_find(shown_) == shown_.end();
  }

  void read_turn() {
    const auto* m = reinterpret_cast<const std::int32_t*>(
        av_stream_get_side_data(stream(), AV_PKT_DATA_DISPLAYMATRIX, nullptr));
    if (m == nullptr) return;
    // A pixel (x, y) is shown at (m[0] x + m[3] y, m[1] x + m[4] y) and a translation.
    const bool straight = m[1] == 0 && m[3] == 0 && m[0] != 0 && m[4] != 0;
    const bool turned = m[0] == 0 && m[4] == 0 && m[1] != 0 && m[3] != 0;
    if (straight)
      turn_ = {false, m[0] < 0, m[4] < 0};
    else if (turned)
      turn_ = {true, m[3] < 0, m[1] < 0};
    else
      throw std::runtime_error("the video states a rotation that is not a multiple of 90 degrees");
  }

  void look_at_colours() {
    const AVColorTransferCharacteristic transfer = stream()->codecpar->color_trc;
    if (transfer == AVCOL_TRC_SMPTE2084 || transfer == AVCOL_TRC_ARIB_STD_B67)
      ignored_.push_back("the video is HDR, whose brightness is not converted: colours will be pale");
    const AVPixFmtDescriptor* format =
        av_pix_fmt_desc_get(static_cast<AVPixelFormat>(stream()->codecpar->format));
    if (format != nullptr && (format->flags & AV_PIX_FMT_FLAG_ALPHA) != 0)
      ignored_.push_back("the transparency of the video is not used");
  }

  void rewind() {
    open();
    next_ = 0, drained_ = false, lost_ = false;
  }

  // Reads the next packet of the stream into packet_. Returns false at the end of the file.
  bool next_packet() {
    for (;;) {
      av_packet_unref(packet_.get());
      const int code = av_read_frame(format_.get(), packet_.get());
      if (code == AVERROR_EOF) return false;
      check(code, "the file is damaged");
      if (packet_->stream_index == stream_) return true;
    }
  }

  // Decodes the next frame into frame_. Returns false at the end of the file.
  bool decode_next() {
    for (;;) {
      const int code = avcodec_receive_frame(decoder_.get(), frame_.get());
      if (code == 0) return true;
      if (code == AVERROR_EOF) return false;
      if (code != AVERROR(EAGAIN)) failed("damaged frame", code);
      if (drained_) return false;
      if (next_packet()) {
        check(avcodec_send_packet(decoder_.get(), packet_.get()), "damaged frame");
      } else {
        drained_ = true;
        check(avcodec_send_packet(decoder_.get(), nullptr), "damaged frame");
      }
    }
  }

  // Sets the position to the last key frame that is shown at the same time as frame `index` or before.
  // Returns false if there is none.
  bool jump(int index) {
    const std::int64_t time = shown_[static_cast<std::size_t>(index)];
    const KeyFrame* best = nullptr;
    for (const KeyFrame& key : keys_)
      if (key.pts <= time && (best == nullptr || key.pts > best->pts)) best = &key;
    if (best == nullptr || av_seek_frame(format_.get(), stream_, best->dts, AVSEEK_FLAG_BACKWARD) < 0)
      return false;
    avcodec_flush_buffers(decoder_.get());
    drained_ = false;
    return true;
  }

  // Decodes until a frame that is shown at the time of frame `index`. Returns false if a later frame comes
  // first.
  bool decode_until(int index) {
    const std::int64_t time = shown_[static_cast<std::size_t>(index)];
    while (decode_next()) {
      const std::int64_t found = frame_->best_effort_timestamp;
      if (found == time) {
        if (frame_->decode_error_flags != 0 || (frame_->flags & AV_FRAME_FLAG_CORRUPT) != 0)
          throw std::runtime_error("it is damaged");
        next_ = index + 1;
        return true;
      }
      if (found > time) return false;
    }
    return false;
  }

  // Decodes frame `index` into frame_.
  void find(int index) {
    if (!timed_) {
      if (lost_ || index < next_) rewind();
      for (; next_ <= index; ++next_)
        if (!decode_next()) throw std::runtime_error("the video ends before it");
      return;
    }
    std::string reason = "the video ends before it, or it is damaged";
    // A damaged frame in between, or a container that cannot seek to this frame, lets an attempt fail.
    enum class Way { onwards, jump, from_the_start };
    for (const Way way : {Way::onwards, Way::jump, Way::from_the_start}) try {
        if (way == Way::onwards && (lost_ || index < next_ || index > next_ + kDecodeAhead)) continue;
        if (way == Way::jump && (!decoder_ || !jump(index))) continue;
        if (way == Way::from_the_start) rewind();
        if (!decode_until(index)) continue;
        lost_ = false;
        return;
      } catch (const std::runtime_error& error) {
        reason = error.what();
      }
    throw std::runtime_error(reason);
  }

  VideoPixels converted() {
    const AVFrame& f = *frame_;
    if (f.width != stored_width_ || f.height != stored_height_)
      throw std::runtime_error("it has another size than the video");
    bool full = f.color_range == AVCOL_RANGE_JPEG;
    const AVPixelFormat format = without_range(static_cast<AVPixelFormat>(f.format), full);
    const AVPixFmtDescriptor* layout = av_pix_fmt_desc_get(format);
    if (layout != nullptr && layout->nb_components <= 2 && f.color_range == AVCOL_RANGE_UNSPECIFIED)
      full = true;  // grey
    const bool rgb = layout != nullptr && (layout->flags & AV_PIX_FMT_FLAG_RGB) != 0;
    const AVColorSpace matrix = rgb ? AVCOL_SPC_BT709  // not used
                                : f.colorspace == AVCOL_SPC_UNSPECIFIED || f.colorspace == AVCOL_SPC_RESERVED
                                    ? usual_matrix(f.width, f.height)
                                    : f.colorspace;
    if (!scaler_ || format != scaler_format_ || matrix != scaler_matrix_ || full != scaler_full_) {
      scaler_ = converter(f.width, f.height, format, AV_PIX_FMT_RGB24, matrix, full, true);
      scaler_format_ = format, scaler_matrix_ = matrix, scaler_full_ = full;
    }
    VideoPixels image{f.width, f.height, {}};
    // libswscale may write a few bytes beyond the end of a row.
    const int row = FFALIGN(3 * f.width, 64);
    std::vector<std::uint8_t> rows(static_cast<std::size_t>(row) * static_cast<std::size_t>(f.height) + 64);
    std::uint8_t* const to[4] = {rows.data(), nullptr, nullptr, nullptr};
    const int steps[4] = {row, 0, 0, 0};
    check(sws_scale(scaler_.get(), f.data, f.linesize, 0, f.height, to, steps), "cannot convert its colours");
    image.width = width(), image.height = height();
    image.rgb.resize(std::size_t{3} * static_cast<std::size_t>(f.width) * static_cast<std::size_t>(f.height));
    std::uint8_t* out = image.rgb.data();
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x, out += 3) {
        const int u = turn_.reverse_x ? image.width - 1 - x : x,
                  v = turn_.reverse_y ? image.height - 1 - y : y;
        const int column = turn_.swap ? v : u, line = turn_.swap ? u : v;
        std::copy_n(rows.data() + std::ptrdiff_t{row} * line + std::ptrdiff_t{3} * column, 3, out);
      }
    return image;
  }

  std::string path_;
  Owned<AVFormatContext> format_;
  Owned<AVCodecContext> decoder_;
  Owned<AVPacket> packet_{made(av_packet_alloc())};
  Owned<AVFrame> frame_{made(av_frame_alloc())};
  Owned<SwsContext> scaler_;
  AVPixelFormat scaler_format_ = AV_PIX_FMT_NONE;
  AVColorSpace scaler_matrix_ = AVCOL_SPC_UNSPECIFIED;
  bool scaler_full_ = false;
  int stream_ = 0, stored_width_ = 0, stored_height_ = 0;
  Turn turn_;
  std::vector<std::int64_t> shown_;  // times of the frames, in the order in which they are shown
  std::vector<KeyFrame> keys_;
  std::vector<std::string> ignored_;
  bool timed_ = true, drained_ = false, lost_ = false;
  int next_ = 0;  // the number of the frame that decode_next() decodes
};

class LibavEncoder final : public VideoEncoder {
 public:
  LibavEncoder(const VideoFormat& wanted, const std::string& path, int width, int height, double fps) {
    const AVCodec* codec = avcodec_find_encoder_by_name(wanted.encoder);
    if (codec == nullptr) throw std::runtime_error("this encoder is missing");
    AVFormatContext* format = nullptr;
    check(avformat_alloc_output_context2(&format, nullptr, wanted.container, nullptr),
          "cannot write the video");
    format_.reset(format);
    encoder_.reset(made(avcodec_alloc_context3(codec)));
    AVCodecContext& c = *encoder_;
    const bool jpeg = codec->id == AV_CODEC_ID_MJPEG;
    c.width = width, c.height = height;
    c.framerate = av_d2q(fps, 65535);  // MPEG-4 allows no larger denominator
    c.time_base = av_inv_q(c.framerate);
    c.pix_fmt = jpeg ? AV_PIX_FMT_YUVJ420P : AV_PIX_FMT_YUV420P;
    // Players and ubs use this matrix for a file of this size without tags, so colours are right in either
    // case. Motion JPEG cannot state a matrix; it is that of BT.601, with the full range.
    c.colorspace = jpeg ? AVCOL_SPC_BT470BG : usual_matrix(width, height);
    c.color_range = jpeg ? AVCOL_RANGE_JPEG : AVCOL_RANGE_MPEG;
    c.color_primaries = AVCOL_PRI_BT709;
    c.color_trc = AVCOL_TRC_BT709;
    if (codec->id != AV_CODEC_ID_H264) {  // x264 has a constant quality of its own
      c.flags |= AV_CODEC_FLAG_QSCALE;
      c.global_quality = 2 * FF_QP2LAMBDA;
    }
    if ((format->oformat->flags & AVFMT_GLOBALHEADER) != 0) c.flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
    check(avcodec_open2(&c, codec, nullptr), "the encoder failed");
    stream_ = made(avformat_new_stream(format, nullptr));
    check(avcodec_parameters_from_context(stream_->codecpar, &c), "cannot write the video");
    stream_->time_base = c.time_base;
    stream_->avg_frame_rate = c.framerate;
    bool full = jpeg;
    scaler_ =
        converter(width, height, AV_PIX_FMT_RGB24, without_range(c.pix_fmt, full), c.colorspace, true, full);
    frame_->format = c.pix_fmt, frame_->width = width, frame_->height = height;
    frame_->colorspace = c.colorspace, frame_->color_range = c.color_range;
    check(av_frame_get_buffer(frame_.get(), 0), "cannot write the video");
    check(avio_open(&format->pb, ("file:" + path).c_str(), AVIO_FLAG_WRITE), "cannot write the video");
    check(avformat_write_header(format, nullptr), "cannot write the video");
  }
  ~LibavEncoder() override {
    if (format_) avio_closep(&format_->pb);
  }

  void write(const std::vector<std::uint8_t>& rgb) override {
    check(av_frame_make_writable(frame_.get()), "cannot write the video");
    const std::uint8_t* const from[4] = {rgb.data(), nullptr, nullptr, nullptr};
    const int steps[4] = {3 * frame_->width, 0, 0, 0};
    check(sws_scale(scaler_.get(), from, steps, 0, frame_->height, frame_->data, frame_->linesize),
          "the encoder failed");
    frame_->pts = next_++;
    frame_->quality = encoder_->global_quality;
    encode(frame_.get());
  }

  void finish() override {
    encode(nullptr);
    check(av_write_trailer(format_.get()), "cannot write the video");
    avio_flush(format_->pb);
    check(format_->pb->error, "cannot write the video");
    check(avio_closep(&format_->pb), "cannot write the video");
  }

 private:
  struct FreeOutput {
    void operator()(AVFormatContext* p) const { avformat_free_context(p); }
  };

  void encode(const AVFrame* frame) {
    check(avcodec_send_frame(encoder_.get(), frame), "the encoder failed");
    for (;;) {
      const int code = avcodec_receive_packet(encoder_.get(), packet_.get());
      if (code == AVERROR(EAGAIN) || code == AVERROR_EOF) return;
      check(code, "the encoder failed");
      packet_->duration = 1;
      av_packet_rescale_ts(packet_.get(), encoder_->time_base, stream_->time_base);
      packet_->stream_index = stream_->index;
      check(av_interleaved_write_frame(format_.get(), packet_.get()), "cannot write the video");
    }
  }

  std::unique_ptr<AVFormatContext, FreeOutput> format_;
  Owned<AVCodecContext> encoder_;
  Owned<AVPacket> packet_{made(av_packet_alloc())};
  Owned<AVFrame> frame_{made(av_frame_alloc())};
  Owned<SwsContext> scaler_;
  AVStream* stream_ = nullptr;
  std::int64_t next_ = 0;
};

// FFmpeg writes its messages to stderr; ubs reports errors itself.
void silence() { av_log_set_level(AV_LOG_QUIET); }

}  // namespace

std::unique_ptr<VideoDecoder> open_video_decoder(const std::string& path) {
  silence();
  return std::make_unique<LibavDecoder>(path);
}

std::unique_ptr<VideoEncoder> open_video_encoder(const VideoFormat& format, const std::string& path,
                                                 int width, int height, double fps) {
  silence();
  return std::make_unique<LibavEncoder>(format, path, width, height, fps);
}

}  // namespace ubs
