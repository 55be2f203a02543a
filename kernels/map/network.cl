// SPDX-License-Identifier: Apache-2.0
// These kernels compute the layers of a convolutional network, except for its matrix products. The network computes
// features of an image for the metric LPIPS. Images and features are planar. Channel c starts at c * plane, and rows
// follow each other without gaps. `plane` is a multiple of 16, so that a work-item may load and store UBS_VW pixels
// even if these extend past the last pixel. Dimension 1 of the launches enumerates channels, or rows of a matrix.

// Converts a pixel of an image to the input of the network, or to that of the window sums of SSIM (ssim_valid.cl).
// Clamps the value to [0, 1] and computes value * scale + offset, where scale and offset depend on the channel. The
// image is passed either as `bytes`, with 8 bit values of shape (3, height, width) that are divided by 255, or as
// `values`, with float planes padded to (rows, pitch).
UBS_KERNEL void load_image(UBS_GLOBAL const uchar* bytes, UBS_GLOBAL const real* values, int width, int height,
                           int pitch, int rows, real scale_r, real scale_g, real scale_b, real offset_r,
                           real offset_g, real offset_b, int plane, UBS_GLOBAL real* out) {
  int pixel = (int)UBS_GLOBAL_ID(0);
  int channel = (int)UBS_GLOBAL_ID(1);
  if (pixel >= plane) return;
  real value = R(0.0);
  if (pixel < width * height) {
    int y = pixel / width, x = pixel - y * width;
    if (bytes)
      value = (real)bytes[(size_t)channel * width * height + pixel] * R(0.00392156862745098);
    else
      value = values[((size_t)channel * rows + y) * pitch + x];
    value = ubs_min(ubs_max(value, R(0.0)), R(1.0));
  }
  real scale = channel == 0 ? scale_r : (channel == 1 ? scale_g : scale_b);
  real offset = channel == 0 ? offset_r : (channel == 1 ? offset_g : offset_b);
  out[(size_t)channel * plane + pixel] = value * scale + offset;
}

// Writes the matrix that turns a convolution into a matrix product. The matrix has one row for each (channel, window y,
// window x), and one column for each of `count` output pixels, starting with output pixel `first`. Entries that
// correspond to pixels outside the image are zero.
UBS_KERNEL void im2col(UBS_GLOBAL const real* image, int width, int height, int plane, int window, int stride,
                       int padding, int out_width, int first, int count, int pitch, UBS_GLOBAL real* matrix) {
  int column = (int)(UBS_GLOBAL_ID(0) * UBS_VW);
  int row = (int)UBS_GLOBAL_ID(1);
  if (column >= count) return;
  int channel = row / (window * window);
  int in_window = row - channel * window * window;
  int window_y = in_window / window;
  int window_x = in_window - window_y * window;
  UBS_GLOBAL const real* from = image + (size_t)channel * plane;
  UBS_GLOBAL real* to = matrix + (size_t)row * pitch + column;
  int out_y = (first + column) / out_width;
  int out_x = first + column - out_y * out_width;
  int y = out_y * stride - padding + window_y;
  int x = out_x * stride - padding + window_x;
#if UBS_VW > 1
  if (stride == 1 && out_x + UBS_VW <= out_width && y >= 0 && y < height && x >= 0 && x + UBS_VW <= width) {
    UBS_STORE(UBS_LOAD(from + (size_t)y * width + x), to);
    return;
  }
#endif
  for (int lane = 0; lane < UBS_VW; ++lane) {
    bool inside = y >= 0 && y < height && x >= 0 && x < width;
    to[lane] = inside ? from[(size_t)y * width + x] : R(0.0);
    ++out_x;
    x += stride;
    if (out_x == out_width) {
      out_x = 0;
      x = window_x - padding;
      y += stride;
    }
  }
}

// Replaces each value x by max(x + bias, 0), with one bias per channel. The first channel starts at element `first`.
UBS_KERNEL void bias_relu(UBS_GLOBAL real* features, int first, UBS_GLOBAL const real* bias, int plane) {
  int pixel = (int)(UBS_GLOBAL_ID(0) * UBS_VW);
  int channel = (int)UBS_GLOBAL_ID(1);
  if (pixel >= plane) return;
  UBS_GLOBAL real* at = features + first + (size_t)channel * plane + pixel;
  vreal value = UBS_LOAD(at) + bias[channel];
  value = ubs_max(value, V(0.0));
  UBS_STORE(value, at);
}

// Computes the largest value of each window. Windows at the right and lower edges may extend past the image.
UBS_KERNEL void max_pool(UBS_GLOBAL const real* image, int width, int height, int plane, int window, int stride,
                         int out_width, int out_height, int out_plane, UBS_GLOBAL real* out) {
  int pixel = (int)UBS_GLOBAL_ID(0);
  int channel = (int)UBS_GLOBAL_ID(1);
  if (pixel >= out_width * out_height) return;
  int out_y = pixel / out_width;
  int y0 = out_y * stride, x0 = (pixel - out_y * out_width) * stride;
  int y1 = y0 + window < height ? y0 + window : height;
  int x1 = x0 + window < width ? x0 + window : width;
  UBS_GLOBAL const real* from = image + (size_t)channel * plane;
  real most = from[(size_t)y0 * width + x0];
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) {
      real value = from[(size_t)y * width + x];
      most = ubs_max(most, value);
    }
  out[(size_t)channel * out_plane + pixel] = most;
}

// Computes the distance between two feature maps at each pixel. Writes zeros from pixel `pixels` to the end of the
// plane.
UBS_KERNEL void lpips_distance(UBS_GLOBAL const real* a, UBS_GLOBAL const real* b,
                               UBS_GLOBAL const real* weights, int channels, int pixels, int plane,
                               UBS_GLOBAL real* distances) {
  int pixel = (int)(UBS_GLOBAL_ID(0) * UBS_VW);
  if (pixel >= plane) return;
  vreal square_a = V(0.0), square_b = V(0.0), distance = V(0.0);
  for (int c = 0; c < channels; ++c) {
    size_t at = (size_t)c * plane + pixel;
    vreal va = UBS_LOAD(a + at), vb = UBS_LOAD(b + at);
    square_a += va * va;
    square_b += vb * vb;
  }
  vreal inverse_a = lpips_inverse_norm(square_a), inverse_b = lpips_inverse_norm(square_b);
  for (int c = 0; c < channels; ++c) {
    size_t at = (size_t)c * plane + pixel;
    distance += lpips_term(weights[c], UBS_LOAD(a + at), inverse_a, UBS_LOAD(b + at), inverse_b);
  }
  vmask real_pixel = ubs_lane_indices((uint)pixel) < (uint)pixels ? (vmask)(-1) : (vmask)(0);
  UBS_STORE(real_pixel ? distance : V(0.0), distances + pixel);
}

// Computes partial sums of `count` values, starting at element `first`. The values are divided into groups of UBS_VW.
// Work-item i adds the groups i, i + items, i + 2 items and so on, lane by lane, and writes its UBS_VW sums to
// `sums`, starting at element sums_offset + i * UBS_VW. `count` is a multiple of UBS_VW.
UBS_KERNEL void partial_sums(UBS_GLOBAL const real* values, int first, int count, int items, int sums_offset,
                             UBS_GLOBAL real* sums) {
  int item = (int)UBS_GLOBAL_ID(0);
  if (item >= items) return;
  vreal total = V(0.0);
  for (int at = item * UBS_VW; at < count; at += items * UBS_VW) total += UBS_LOAD(values + first + at);
  UBS_STORE(total, sums + sums_offset + item * UBS_VW);
}
