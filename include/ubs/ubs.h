/* SPDX-License-Identifier: Apache-2.0
 *
 * ubs.h is the C interface of the library ubs (Universal Beta Splatting). Programs use it to open devices and
 * data, to train and render models, and to compute gradients of rendered images with respect to every raw
 * parameter. It requires C99; ubs.hpp wraps it for C++. Examples are in docs/library.md.
 * A program that renders calls ubs_device_open, ubs_model_load, ubs_renderer_create and ubs_renderer_draw.
 * A program that trains calls ubs_device_open, ubs_data_open, ubs_trainer_create, ubs_trainer_run and
 * ubs_trainer_get_model.
 *
 * - Errors: functions that can fail return a ubs_status. If it is not UBS_OK, ubs_error_message() returns a
 *   line that describes the problem and what to do about it. A function that fails does not change its
 *   outputs, with two exceptions: it sets new handles to NULL, and an image may be incomplete if the device
 *   fails while the image is copied.
 *
 * - Handles: functions with a parameter such as ubs_model** return a new handle. The program must free it
 *   with the _free function of its type, which also accepts NULL. Handles can be freed in any order, because
 *   an object that was made from another handle keeps the data that it needs.
 *
 * - Memory: input arrays are copied before the function returns. Output arrays belong to the caller and must
 *   have the size that the function requires. Pointers into a handle are valid until the handle is freed.
 *
 * - Images: the first row is the top row, and rows have no padding. Colour images with float values have the
 *   shape (height, width, 3), in the order R, G, B, with values from 0 to 1. Alpha and depth have the shape
 *   (height, width).
 *
 * - World: the coordinate system is right-handed, and lengths have the unit of the data. Cameras have the
 *   axes of COLMAP: x right, y down, z forward.
 *
 * - Structs begin with the member `size`. The caller must set it to the size of the struct before every call,
 *   so that later versions can add members at the end. For example, ubs_camera camera = {sizeof camera}; also
 *   sets all other members to 0.
 *
 * - Threads: any thread may call any function. Calls that use the same device handle wait for each other;
 *   calls that use different device handles do not. A handle must not be used or freed while another thread
 *   calls a function that changes it. These are the functions that take the handle without `const`. Error
 *   messages are stored per thread.
 *
 * - Results: the same settings, data, device and build give bit-identical results, from C, from Python and
 *   from the executable.
 */
#ifndef UBS_UBS_H
#define UBS_UBS_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define UBS_API __attribute__((visibility("default")))
#else
#define UBS_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* This number increases when a function or a struct changes in a way that requires programs to be
 * recompiled. */
#define UBS_ABI_VERSION 1

/* The numbers are the exit codes of the executable. */
typedef enum ubs_status {
  UBS_OK = 0,
  UBS_ERROR_INTERNAL = 1,  /* a bug in ubs: please report it */
  UBS_ERROR_USAGE = 2,     /* wrong arguments or settings */
  UBS_ERROR_DATA = 3,      /* unreadable, corrupt or inconsistent input, or a file that cannot be written */
  UBS_ERROR_DEVICE = 4,    /* the device does not exist, or its driver fails */
  UBS_ERROR_BUILD = 5,     /* kernels do not compile on this device */
  UBS_ERROR_MEMORY = 6,    /* the host or the device has not enough memory */
  UBS_ERROR_NUMERICAL = 7, /* a value that is not finite */
  UBS_ERROR_FAULTY = 10,   /* a device that computes wrong results (docs/check.md) */
  UBS_STOPPED = 130        /* the program has asked the call to end early (ubs_set_stop_flag) */
} ubs_status;

typedef struct ubs_device ubs_device;
typedef struct ubs_settings ubs_settings;
typedef struct ubs_data ubs_data;
typedef struct ubs_model ubs_model;
typedef struct ubs_renderer ubs_renderer;
typedef struct ubs_trainer ubs_trainer;
typedef struct ubs_meter ubs_meter;

/* ---- Library ---- */

/* These functions return UBS_ABI_VERSION and the version (for example "0.2.0") of the loaded library. */
UBS_API uint32_t ubs_abi_version(void);
UBS_API const char* ubs_version(void);

/* Returns the error message of the last call in this thread that failed, or an empty text if no call has
 * failed. The result is never NULL. It is valid until the next call that fails in this thread. */
UBS_API const char* ubs_error_message(void);

/* Type of a function that receives log lines. Lines with level 0 are notices, for example about operations
 * that take time; lines with level 1 are warnings. ubs_set_log sets the function for the whole process. Other
 * functions of the library call it, but only one thread at a time; it must not throw exceptions. If no
 * function is set, or if it is NULL, warnings are written to stderr. */
typedef void (*ubs_log_function)(void* user, int level, const char* line);
UBS_API void ubs_set_log(ubs_log_function function, void* user);

/* Lets another thread end calls of this thread early that create an object: they read or create data, and
 * compile kernels. Such calls read `*flag` at intervals. If it is not 0, they may return UBS_STOPPED without
 * a result. The number must exist until the function is called again in this thread, with NULL or another
 * number. Set it to NULL before calls that change an object, because they must not end halfway. */
UBS_API void ubs_set_stop_flag(int32_t* flag);

/* ---- Devices ---- */

typedef enum ubs_device_type {
  UBS_DEVICE_CPU = 0,
  UBS_DEVICE_GPU = 1,
  UBS_DEVICE_ACCELERATOR = 2
} ubs_device_type;

typedef struct ubs_device_info {
  size_t size;
  char backend[16]; /* "opencl" or "cuda" */
  char platform[128], vendor[128], name[256], driver[128];
  int32_t type; /* ubs_device_type */
  uint32_t compute_units;
  uint64_t memory_bytes, max_allocation_bytes;
  uint64_t allocated_bytes, peak_bytes; /* device memory of this handle; 0 if the device is not open */
} ubs_device_info;

UBS_API ubs_status ubs_device_count(size_t* count);
/* Describes the device with this index. Devices are counted from 0, in the order of `ubs devices`. */
UBS_API ubs_status ubs_device_describe(size_t index, ubs_device_info* info);

/* Opens a device. `request` is an index such as "0", or "cpu", "gpu", "cuda" or "opencl", or a part of the
 * name of the device. If it is NULL or "", the environment variable UBS_DEVICE is used. If this is not set
 * either, the first GPU is opened, or the first device if there is no GPU. A device may be opened several
 * times.
 * Before a device is used for a model variant for the first time, its results are compared with float64
 * results. This takes seconds, and is done once for each device, driver and build. If the device computes
 * wrong results, the function that uses it returns UBS_ERROR_FAULTY. If the environment variable UBS_CHECK is
 * "off", results are not compared. */
UBS_API ubs_status ubs_device_open(const char* request, ubs_device** device);
UBS_API ubs_status ubs_device_get_info(const ubs_device* device, ubs_device_info* info);
UBS_API void ubs_device_free(ubs_device* device);

/* ---- Settings, with the names and values of `ubs train --help` and of YAML files ---- */

UBS_API ubs_status ubs_settings_create(ubs_settings** settings);
UBS_API ubs_status ubs_settings_copy(const ubs_settings* settings, ubs_settings** copy);
UBS_API void ubs_settings_free(ubs_settings* settings);
/* Loads settings from a YAML file. Settings that are not in the file keep their values. */
UBS_API ubs_status ubs_settings_load(ubs_settings* settings, const char* path);
/* Sets a value, for example "iterations" to "7000", or "background" to "1,1,1". Returns UBS_ERROR_USAGE if
 * the key does not exist or the value is not allowed. */
UBS_API ubs_status ubs_settings_set(ubs_settings* settings, const char* key, const char* value);
/* Copies the value of a setting as text to `value`, which has `capacity` bytes. A text that does not fit is
 * truncated; the copy always ends with a 0 byte. *length is set to the length of the complete text without
 * the 0 byte. `value` and `length` may be NULL. */
UBS_API ubs_status ubs_settings_get(const ubs_settings* settings, const char* key, char* value,
                                    size_t capacity, size_t* length);
/* Returns the name and the description of the setting with the number `index`, from 0 on. Both are NULL if
 * there are fewer settings. The pointers are always valid. */
UBS_API ubs_status ubs_settings_describe(size_t index, const char** key, const char** help);

typedef enum ubs_use {
  UBS_USE_DATA = 0,     /* for ubs_data_open */
  UBS_USE_MODEL = 1,    /* for ubs_model_create */
  UBS_USE_RENDERER = 2, /* for ubs_renderer_create */
  UBS_USE_TRAINER = 3   /* for ubs_trainer_create and ubs_model_create_initial */
} ubs_use;

/* Returns UBS_ERROR_USAGE if a setting that was set or loaded has no effect on the functions that `use`
 * stands for. These functions ignore such settings, so that a program can pass the same ubs_settings to all
 * of them. */
UBS_API ubs_status ubs_settings_check(const ubs_settings* settings, ubs_use use);

/* ---- Data: views with cameras and images, in the splits "train", "test" and "val" ---- */

typedef struct ubs_camera {
  size_t size;
  double world_to_camera[12]; /* (3, 4) row-major matrix (R, t): p_camera = R p_world + t */
  /* Focal lengths and principal point [px]. The centre of the first pixel is at (0.5, 0.5). */
  double fx, fy, cx, cy;
  int32_t width, height; /* [px] */
  double time;           /* for models with time; the training views have times from 0 to 1 */
  uint32_t extra_count;  /* number of values in `extra`, at most 4 */
  double extra[4];       /* further query values, for models with N = 5 and N >= 8 */
} ubs_camera;

typedef struct ubs_view {
  size_t size;
  ubs_camera camera; /* the caller need not set its `size` */
  int32_t has_image, has_mask;
  char name[256];
} ubs_view;

/* Opens a data folder of any supported layout, or a packed file (docs/data.md). `settings` determines how the
 * data are read, for example the layout, the background and the reduction of the images. If it is NULL, the
 * default settings are used. */
UBS_API ubs_status ubs_data_open(const char* path, const ubs_settings* settings, ubs_data** data);

/* Describes a procedural scene, as `ubs synth` makes it. `scene` must be set. If another member is 0, its
 * default value, which is given in brackets, is used. */
typedef struct ubs_synthetic {
  size_t size;
  const char* scene;     /* "glossy" (static, with reflections), "orbit" (dynamic) or "cloud" (a volume) */
  int32_t width, height; /* size of the images [100 px] */
  int32_t train_views;   /* number of training views [40] */
  int32_t test_views;    /* number of test views [8]; -1 makes no test views */
  int32_t val_views;     /* number of validation views [0] */
  int32_t supersampling; /* number of rays per pixel along each axis [3] */
  uint64_t seed;         /* determines the cameras and the shape of the cloud */
  int32_t overwrite;     /* if not 0, the files of an earlier scene in the folder are replaced */
} ubs_synthetic;

/* Writes a procedural scene into `folder`, which ubs_data_open can open. Two calls with the same values in
 * `scene` write identical files. */
UBS_API ubs_status ubs_data_synthesise(const ubs_synthetic* scene, const char* folder);
/* Creates an empty data set. ubs_data_add_view and ubs_data_set_points fill it. */
UBS_API ubs_status ubs_data_create(ubs_data** data);
UBS_API void ubs_data_free(ubs_data* data);
/* Appends a view to a split. camera.time must be between 0 and 1. `name` must be unique in its split, and
 * valid as a file name without extension. If it is NULL, the name is the number of the view. `rgb` contains
 * (height, width, 3) bytes, already composited on the background. It is NULL for a view without an image.
 * `mask` contains (height, width) bytes; pixels whose byte is 0 are ignored. If it is NULL, the view has no
 * mask. */
UBS_API ubs_status ubs_data_add_view(ubs_data* data, const char* split, const char* name,
                                     const ubs_camera* camera, const uint8_t* rgb, const uint8_t* mask);
/* Sets the points at which initial models have splats. `positions` (count, 3) are in world coordinates.
 * `colours` is (count, 3), or NULL for grey points. */
UBS_API ubs_status ubs_data_set_points(ubs_data* data, size_t count, const float* positions,
                                       const uint8_t* colours);
/* Sets *count to the number of views of a split, or to 0 if the split does not exist. */
UBS_API ubs_status ubs_data_view_count(const ubs_data* data, const char* split, size_t* count);
UBS_API ubs_status ubs_data_get_view(const ubs_data* data, const char* split, size_t index, ubs_view* view);
/* Copies the image of a view to `rgb` (height, width, 3), and its mask to `mask` (height, width). Each of the
 * two arrays may be NULL. If the view has no mask, all values of `mask` are set to 255. Returns
 * UBS_ERROR_DATA if the view has no image. */
UBS_API ubs_status ubs_data_get_image(const ubs_data* data, const char* split, size_t index, uint8_t* rgb,
                                      uint8_t* mask);

/* ---- Models: raw parameters in host memory ---- */

typedef struct ubs_model_info {
  size_t size;
  uint32_t dim;        /* N of the first group */
  uint32_t groups;     /* number of groups; splats of different dimensions are in different groups */
  uint64_t splats;     /* number of splats of all groups */
  uint64_t parameters; /* number of parameter values of all splats */
  double offset[3];    /* a splat with the parameters xyz is at the world position xyz + offset */
  char form[256];      /* variant: "default", or the settings of docs/variants.md that have other values */
} ubs_model_info;

typedef struct ubs_parameter {
  size_t size;
  /* Name of the parameter: "xyz", "rgb", "opacity", "beta", "mean", "scale", "l_triangle" and so on
   * (docs/method.md, section 1.2). NULL if the group has no parameter with this index. */
  const char* name;
  uint32_t dim; /* number of dimensions N of the splats of the group */
  uint32_t rows;
  uint64_t splats;
  float* values; /* (rows, splats), row-major; points to memory of the model and may be read and written */
} ubs_parameter;

/* Creates a model with `splats` splats whose parameters are all 0. The settings determine its variant and its
 * dimension. The setting "dim" must be a number, not "auto". */
UBS_API ubs_status ubs_model_create(const ubs_settings* settings, uint64_t splats, ubs_model** model);
/* Creates the initial model of a training with these settings. Its splats are at the points of the data and
 * at points that are triangulated from the images, or at random positions if there are no points. A time
 * limit is ignored: the number of splats is that of a training without it. */
UBS_API ubs_status ubs_model_create_initial(const ubs_data* data, const ubs_settings* settings,
                                            ubs_model** model);
UBS_API ubs_status ubs_model_copy(const ubs_model* model, ubs_model** copy);
/* Creates a model with `splats` splats whose parameters are all 0. Its dimension, variant, offset and
 * settings for rendering are those of `model`. */
UBS_API ubs_status ubs_model_create_like(const ubs_model* model, uint64_t splats, ubs_model** created);
UBS_API void ubs_model_free(ubs_model* model);
/* Loads a model file of any supported format (docs/data.md), or the model in a folder: the output folder of
 * `ubs train` or of 3DGS, or an unpacked SOG file. */
UBS_API ubs_status ubs_model_load(const char* path, ubs_model** model);
/* Saves a model. `format` is one of the formats of `ubs convert --to`. The format "ubs", which NULL also
 * selects, stores the complete model. "auto" selects the format by the extension of the path, and "ubs" for
 * .ply; if no format has the extension, the function returns UBS_ERROR_USAGE.
 * Other formats than "ubs" store the model at the time `time`. The dependence on the direction is averaged
 * over the cameras that the model lists, or over all directions if it lists none. Unlike `ubs convert`, the
 * function does not optimise the result to resemble the model. It replaces an existing file, but neither a
 * link nor a folder. */
UBS_API ubs_status ubs_model_save(const ubs_model* model, const char* path, const char* format, double time);
UBS_API ubs_status ubs_model_get_info(const ubs_model* model, ubs_model_info* info);
/* Returns the parameter with the index `index` (from 0 on) of the group with the number `group` (from 0
 * on). */
UBS_API ubs_status ubs_model_get_parameter(ubs_model* model, uint32_t group, uint32_t index,
                                           ubs_parameter* parameter);
/* Returns the settings for rendering the model. They contain the dimension and the variant of the model, and
 * the background, the near and far planes, the blur and alpha_min that its file states. All other settings
 * have their default values. */
UBS_API ubs_status ubs_model_get_settings(const ubs_model* model, ubs_settings** settings);

/* ---- Renderers: a model on a device ---- */

/* Flags of a renderer. UBS_RENDER_DEPTH enables depth images, and UBS_RENDER_GRADIENTS enables gradients.
 * UBS_RENDER_ABSGRAD requires UBS_RENDER_GRADIENTS. With this flag, the gradient with respect to the position
 * of a splat in the image is replaced by sums over the pixels of the absolute values of their contributions,
 * for x and y separately. ubs_renderer_vjp and ubs_renderer_loss then compute the gradients of the positions
 * of the splats from these sums, and gradients with respect to the camera are not available. The sums are a
 * criterion for densification (AbsGS, Ye et al. 2024).
 * With UBS_RENDER_GAUSSIANS, the renderer reads Gaussians from arrays of the program (ubs_gaussians). */
enum { UBS_RENDER_DEPTH = 1, UBS_RENDER_GRADIENTS = 2, UBS_RENDER_ABSGRAD = 4, UBS_RENDER_GAUSSIANS = 8 };

typedef struct ubs_image {
  size_t size;
  /* Arrays that the renderer fills. An array that is not needed may be NULL. */
  float* rgb;   /* (height, width, 3), not clamped */
  float* alpha; /* (height, width) */
  float* depth; /* (height, width), expected depth in units of the world; requires UBS_RENDER_DEPTH */
  /* If this is not 0, the renderer keeps the data that ubs_renderer_vjp needs to differentiate this image
   * without rendering it again. This requires UBS_RENDER_GRADIENTS. */
  int32_t for_gradient;
} ubs_image;

typedef struct ubs_image_gradient {
  size_t size;
  /* If rgb, alpha or depth is NULL, this gradient is 0. UBS_ARRAY_V_RGB, UBS_ARRAY_V_ALPHA and
   * UBS_ARRAY_V_DEPTH of this renderer are passed by their addresses in device memory; all other arrays are
   * in host memory. Values in device memory are not checked. */
  const float* rgb;   /* (height, width, 3) */
  const float* alpha; /* (height, width) */
  const float* depth; /* (height, width); requires UBS_RENDER_DEPTH; ignored for pixels with alpha < 1e-6 */
  /* Further channels of images with more than three channels, which are rendered in several passes. With
   * UBS_RENDER_ABSGRAD, a contribution is summed over all channels before its absolute value is taken, so
   * ubs_renderer_vjp needs all channels. Requires UBS_RENDER_ABSGRAD, and depth = NULL. The gradients with
   * respect to positions, shapes and opacities include those of these channels. If more_channels is not 0,
   * none of the three arrays may be NULL. */
  uint32_t more_channels;
  const float* more;         /* (height, width, more_channels): gradient with respect to these channels */
  const float* more_image;   /* the same shape: the channels of the image, without a background */
  const float* more_colours; /* (splats, more_channels): the values of the splats */
} ubs_image_gradient;

/* Gradient with respect to a camera. It only considers changes of the camera after which its rotation matrix
 * is still a rotation. */
typedef struct ubs_camera_gradient {
  size_t size;
  /* Gradient with respect to rotations w about the axes of the camera [1/rad], and then with respect to
   * translations u along these axes: (R, t) -> (exp([w]) R, exp([w]) t + u). */
  double pose[6];
  double world_to_camera[12]; /* gradient with respect to the matrix (3, 4), for the same changes */
  double fx, fy, cx, cy, time;
  double extra[4];
} ubs_camera_gradient;

typedef struct ubs_loss {
  size_t size;
  double loss;     /* (1 - lambda_dssim) l1 + lambda_dssim (1 - ssim) */
  double l1, ssim; /* mean absolute difference, and mean SSIM */
} ubs_loss;

/* Gaussians in arrays of the program, with the layout of PyTorch and similar packages, or the gradients with
 * respect to such Gaussians. The arrays are in the memory of the device of the renderer, which must be a CUDA
 * device or a CPU with PoCL. They are not copied. */
typedef struct ubs_gaussians {
  size_t size;
  uint64_t count;
  float* means;     /* (count, 3) */
  float* quats;     /* (count, 4), w first, of any length but 0 */
  float* scales;    /* (count, 3), above 0: standard deviations along the axes */
  float* opacities; /* (count), 0 to 1 */
  float* colours;   /* (count, bases, 3): coefficients of the spherical harmonics, or plain colours */
  uint32_t bases;   /* at least as many as the renderer needs (1 for plain colours); others are not used */
} ubs_gaussians;

/* Creates a renderer and copies the model to the device. Parameters that are not finite are refused with
 * UBS_ERROR_NUMERICAL, except with UBS_RENDER_GAUSSIANS, where they are not used. If `settings` is NULL, the
 * settings of ubs_model_get_settings are used. `flags` determines which operations the renderer supports.
 * Gradients with respect to positions include the effect of a position on the view direction. The published
 * training ignores this effect. To ignore it here too, set "query_grad" to "false". */
UBS_API ubs_status ubs_renderer_create(ubs_device* device, const ubs_model* model,
                                       const ubs_settings* settings, unsigned flags, ubs_renderer** renderer);
/* Describes a user-defined falloff of splats, which replaces (1 - r)^beta. For r < support, the opacity is
 * multiplied by 2^log2; elsewhere it is 0. r is the squared distance from the centre in units of the ellipse.
 * The texts are expressions of the variables r and beta (the beta of the splat). They must be valid in both
 * OpenCL C and CUDA C++, and must not contain blanks. r and beta have the type vreal, and constants are
 * written as V(0.5). The operators + - * / ?: are available, and the functions ubs_exp2, ubs_log, ubs_log2_1m
 * (which is log2(1 - x)), ubs_sqrt, ubs_sin and ubs_cos. The library compiles the texts unchanged for the
 * device. */
typedef struct ubs_falloff {
  size_t size;
  const char* log2;       /* the binary logarithm of the factor of the opacity, at most 0 */
  const char* r_slope;    /* the derivative of `log2` with respect to r */
  const char* beta_slope; /* the derivative of `log2` with respect to beta */
  float support;          /* above 0, at most 100 */
} ubs_falloff;

/* Creates a renderer with a user-defined falloff, and otherwise does the same as ubs_renderer_create. If
 * `falloff` is NULL, the falloff of the model is used. The model must have the spatial kernel "beta". Returns
 * UBS_ERROR_BUILD if the compiler of the device does not accept an expression. The library does not compare
 * the results of this falloff with float64 results; the Python package does. */
UBS_API ubs_status ubs_renderer_create_falloff(ubs_device* device, const ubs_model* model,
                                               const ubs_settings* settings, unsigned flags,
                                               const ubs_falloff* falloff, ubs_renderer** renderer);
UBS_API void ubs_renderer_free(ubs_renderer* renderer);
/* Replaces the model on the device by another model, which must have the same groups, dimensions and
 * variants. Each of its groups must have at most as many splats as in the model that the renderer was created
 * with, and all its parameters must be finite. */
UBS_API ubs_status ubs_renderer_update(ubs_renderer* renderer, const ubs_model* model);
/* Makes a renderer with UBS_RENDER_GAUSSIANS render these Gaussians. Such a renderer is created with a
 * model of any number of splats with dim = 3, kernel = gaussian, rot_mode = quaternion and no lobes; the
 * values of this model are not used. The number of Gaussians may change with each call. The function keeps
 * the addresses: the arrays must exist, with the same values, during all calls of ubs_renderer_draw,
 * ubs_renderer_vjp, ubs_renderer_camera_gradient and ubs_renderer_get_gaussian_gradients. The values are
 * not checked. A Gaussian with a value that is not finite is not rendered. With antialias = on, the blur
 * compensation is at least 0.005, as in gsplat. The functions ubs_renderer_update and ubs_renderer_loss,
 * and UBS_ARRAY_PARAMETERS and UBS_ARRAY_GRADIENT, are not available. */
UBS_API ubs_status ubs_renderer_set_gaussians(ubs_renderer* renderer, const ubs_gaussians* gaussians);
/* Writes the gradients of the last ubs_renderer_vjp, which was called without a model, to arrays of the
 * program, and waits until they are complete. `count` and `bases` must be those of the Gaussians. The
 * function does not write the gradients of coefficients that are not used, and does not check whether
 * gradients are finite. */
UBS_API ubs_status ubs_renderer_get_gaussian_gradients(ubs_renderer* renderer,
                                                       const ubs_gaussians* gradients);
/* Renders a view and copies the arrays of `image` that are not NULL. */
UBS_API ubs_status ubs_renderer_draw(ubs_renderer* renderer, const ubs_camera* camera,
                                     const ubs_image* image);
/* Computes a vector-Jacobian product: renders the view, and converts the gradient `v_image` of a scalar with
 * respect to the pixels to the gradient with respect to every raw parameter. `gradient` receives the result.
 * It must be a model with the same groups and numbers of splats, for example from ubs_model_copy; its values
 * are replaced. If it is NULL, only the gradient with respect to the camera is computed. Requires
 * UBS_RENDER_GRADIENTS.
 * If `camera` is NULL, the function differentiates the last image that was rendered, without rendering it
 * again. This image must have been rendered by this function, or with for_gradient. The function returns
 * UBS_ERROR_USAGE if there is no such image, or if one of these events has happened since it was rendered:
 * gradients of alpha or depth were computed, the parameters were replaced, or UBS_ARRAY_PARAMETERS was
 * requested. */
UBS_API ubs_status ubs_renderer_vjp(ubs_renderer* renderer, const ubs_camera* camera,
                                    const ubs_image_gradient* v_image, ubs_model* gradient);
/* Renders a view and computes the training loss compared with the image `target` (height, width, 3). 1 - SSIM
 * has the weight lambda_dssim in the loss. If `gradient` is not NULL, it receives the gradient of the loss
 * without penalties, as in ubs_renderer_vjp. `mask` is NULL or contains (height, width) bytes; pixels whose
 * byte is 0 are ignored. */
UBS_API ubs_status ubs_renderer_loss(ubs_renderer* renderer, const ubs_camera* camera, const float* target,
                                     const uint8_t* mask, float lambda_dssim, ubs_loss* loss,
                                     ubs_model* gradient);

/* Returns the gradient with respect to the camera for the last call of ubs_renderer_vjp, or of
 * ubs_renderer_loss with a gradient. It always includes the effect of the camera on the view direction, even
 * if "query_grad" is "false". Returns UBS_ERROR_USAGE if the background is a sky, or if the renderer was
 * created with UBS_RENDER_ABSGRAD. */
UBS_API ubs_status ubs_renderer_camera_gradient(ubs_renderer* renderer, ubs_camera_gradient* gradient);

/* Arrays of a renderer in the memory of its device, for programs that compute on the same device. They are
 * available on CUDA devices and on CPUs with PoCL. For other devices, ubs_renderer_get_array returns
 * UBS_ERROR_USAGE, because their OpenCL drivers provide no addresses. */
typedef enum ubs_array_name {
  /* Parameters (rows, splats), with rows in the order of ubs_model_get_parameter. They may be written. */
  UBS_ARRAY_PARAMETERS = 0,
  /* The last rendered image (height, width, 3). It is not available after ubs_renderer_vjp was called with a
   * gradient of alpha or depth. */
  UBS_ARRAY_RGB = 1,
  UBS_ARRAY_TRANSMITTANCE = 2, /* (height, width): 1 - alpha of the last rendered image */
  UBS_ARRAY_DEPTH = 3,         /* (height, width): depth of the last rendered image */
  /* An array (height, width, 3) for a gradient of the image. The program sets shape[0] to the height and
   * shape[1] to the width of the view before it requests the array, whose values are then 0. It writes the
   * gradient to the array, and passes the array as rgb to ubs_renderer_vjp. This function may overwrite it.
   */
  UBS_ARRAY_V_RGB = 4,
  /* The last gradient with respect to the parameters, in the layout of UBS_ARRAY_PARAMETERS. */
  UBS_ARRAY_GRADIENT = 5,
  /* (splats, 2): half the width and half the height [px] of the rectangle around the ellipse of each splat in
   * the last image. The values of splats that are not between the near and far planes are undefined. */
  UBS_ARRAY_EXTENTS = 6,
  /* (splats, 2): the last gradient with respect to the position of each splat in the image [1/px], or the
   * sums of UBS_RENDER_ABSGRAD. The values may be written; UBS_ARRAY_GRADIENT and
   * ubs_renderer_camera_gradient are then computed from the written values. */
  UBS_ARRAY_V_MEANS2D = 7,
  /* (splats, 2): the position of each splat in the last image [px]. The positions of splats that are not
   * between the near and far planes are computed with the depth 1. */
  UBS_ARRAY_MEANS2D = 8,
  UBS_ARRAY_DEPTHS = 9, /* (splats): the depth of each splat in the last image, in units of the world */
  /* (splats): the opacity with which each splat is rendered in the last image. The values of splats that are
   * not between the near and far planes are undefined. */
  UBS_ARRAY_OPACITIES = 10,
  UBS_ARRAY_V_ALPHA = 11, /* (height, width): as UBS_ARRAY_V_RGB, for the gradient of alpha */
  /* (height, width): as UBS_ARRAY_V_RGB, for the gradient of depth. Requires UBS_RENDER_DEPTH. */
  UBS_ARRAY_V_DEPTH = 12
} ubs_array_name;

typedef struct ubs_array {
  size_t size;
  float* values; /* address in the memory of the device */
  /* Kind of the memory, as DLPack numbers it (1: host memory, with the number 0; 2: memory of a CUDA device),
   * and number of the device. */
  int32_t type, ordinal;
  int32_t dims;                 /* number of dimensions, 1 to 3 */
  int64_t shape[3], strides[3]; /* size of each dimension, and distance of its elements in floats */
} ubs_array;

/* Waits for the renderer and returns an array. The program must finish using the array before it calls the
 * next function that uses this device. The array is valid until the renderer renders a view of another size
 * or gets another model. `group` is the number of a group of splats. It selects the splats of arrays that
 * have an entry for each splat. */
UBS_API ubs_status ubs_renderer_get_array(ubs_renderer* renderer, ubs_array_name name, uint32_t group,
                                          ubs_array* array);

/* ---- Training ---- */

typedef struct ubs_step {
  size_t size;
  /* Number of finished iterations, and of all iterations of the training. With a time limit, the second
   * number is an estimate, which may change. */
  uint32_t iteration, iterations;
  double seconds; /* training time so far */
  uint64_t splats;
  /* The mean loss since the last iteration that reported it. It is reported every log_every iterations, when
   * test views are measured, and in the last iteration; in all other iterations it is NaN. */
  double loss;
  /* Quality of the test views. It is measured at the interval eval_every and in the last iteration; in all
   * other iterations it is NaN. */
  double test_psnr, test_ssim;
} ubs_step;

typedef struct ubs_metrics {
  size_t size;
  double psnr;       /* mean of the PSNR of the three channels [dB], as published code computes it */
  double psnr_joint; /* PSNR of the mean squared error over all channels [dB] */
  double ssim;       /* with a Gaussian window of 11 x 11 pixels; outside of the image, pixels are 0 */
  double ssim_valid; /* over windows inside of the image; NaN if the image is smaller than a window */
  /* LPIPS, or NaN for networks that were not requested. The networks expect input from -1 to 1, so they get
   * 2 v - 1 for a pixel value v. Published evaluations of splats pass v itself; the names with _unit stand
   * for these values. */
  double lpips_alex, lpips_squeeze, lpips_vgg;
  double lpips_alex_unit, lpips_squeeze_unit, lpips_vgg_unit;
} ubs_metrics;

/* Type of a function that is called after every iteration. If it returns 0, the run stops. It may use other
 * handles, and may read, evaluate and save the trainer, but not change it. */
typedef int (*ubs_step_function)(void* user, const ubs_step* step);

/* Creates a trainer. `settings` are those of `ubs train`, with the same defaults; if it is NULL, all settings
 * have their defaults. Values that are "auto" are chosen for the data and the length of the training, as
 * `ubs train` chooses them (docs/budget.md). Without a length ("iterations" or "budget"), training takes
 * 16 000 iterations or 15 minutes, whichever ends first, or 30 000 iterations if "schedule" is "published".
 * With a time limit, the function measures some training steps to choose the number of iterations, and the
 * time starts with the call of this function.
 * Settings that determine how the data are read must have the values that `data` was opened with. `initial`
 * is the initial model, which must have the dimension and the variant of the settings. If "dim" or
 * "conditioning" is "auto", the value is that of this model. If `initial` is NULL, the trainer creates the
 * initial model in the same way as ubs_model_create_initial. */
UBS_API ubs_status ubs_trainer_create(ubs_device* device, const ubs_data* data, const ubs_settings* settings,
                                      const ubs_model* initial, ubs_trainer** trainer);
UBS_API void ubs_trainer_free(ubs_trainer* trainer);
/* Trains for `steps` iterations, or to the end if `steps` is 0 or larger than the number of remaining
 * iterations. `function` may be NULL. After an error, the trainer usually has the state of the last complete
 * iteration. But if the error has interrupted an iteration while the model was changing, the state cannot be
 * saved, and ubs_trainer_save returns UBS_ERROR_USAGE. */
UBS_API ubs_status ubs_trainer_run(ubs_trainer* trainer, uint32_t steps, ubs_step_function function,
                                   void* user);
/* Returns the current progress. The loss and the metrics of `step` are those that the last iteration
 * reported. They are NaN if this trainer has not run this iteration, or if its splats have been replaced
 * since. */
UBS_API ubs_status ubs_trainer_get_status(const ubs_trainer* trainer, ubs_step* step);
/* Returns the settings of the training as its checkpoint contains them: the settings that were passed, with
 * the values that were chosen for those that were automatic. ubs_settings_free() frees them. */
UBS_API ubs_status ubs_trainer_get_settings(const ubs_trainer* trainer, ubs_settings** settings);
/* Returns the current model. */
UBS_API ubs_status ubs_trainer_get_model(const ubs_trainer* trainer, ubs_model** model);
/* Replaces the splats during a training, for example to add or remove splats. The iteration, the cameras, the
 * appearance and the background do not change. `model` must have the dimension and the variant of the
 * trainer. Its number of splats must not exceed the larger one of cap_max and the number of splats of the
 * initial model. `from` contains a number for each splat of `model`: the index of the current splat whose
 * optimiser state the splat continues with, or -1 for a new optimiser state. If `from` is NULL, all splats
 * get new states. */
UBS_API ubs_status ubs_trainer_set_model(ubs_trainer* trainer, const ubs_model* model, const int64_t* from);
/* Returns the means of the metrics over the test views. Returns UBS_ERROR_DATA if there are no test views
 * with images. */
UBS_API ubs_status ubs_trainer_evaluate(ubs_trainer* trainer, ubs_metrics* metrics);
/* Returns the metrics of each test view that has an image, and their means. `views` is an array with `count`
 * entries, all of which have the same size; `count` must be the number of these views. If `meter` is not
 * NULL, it must have been created with the device of the trainer. Then ssim_valid and the networks of the
 * meter are measured, too. */
UBS_API ubs_status ubs_trainer_evaluate_views(ubs_trainer* trainer, ubs_meter* meter, ubs_metrics* mean,
                                              size_t count, ubs_metrics* views);
/* ubs_trainer_save writes a checkpoint, and ubs_trainer_restore resumes from a checkpoint. The trainer that
 * resumes must have been created with the same data, settings and device. Otherwise the function returns
 * UBS_ERROR_USAGE or UBS_ERROR_DATA, and the message states the difference. The result of a resumed training
 * is bit-identical to that of an uninterrupted training. */
UBS_API ubs_status ubs_trainer_save(const ubs_trainer* trainer, const char* path);
UBS_API ubs_status ubs_trainer_restore(ubs_trainer* trainer, const char* path);

/* ---- Comparing images ---- */

/* Creates an object that compares images. `networks` lists the networks for LPIPS, for example
 * "alex,squeeze,vgg". If it is NULL or "", LPIPS is not computed. `weights` is a safetensors file, or a
 * folder with files lpips_NAME.safetensors (docs/metrics.md). If it is NULL, the environment variable
 * UBS_LPIPS_WEIGHTS is used. */
UBS_API ubs_status ubs_meter_create(ubs_device* device, const char* networks, const char* weights,
                                    ubs_meter** meter);
UBS_API void ubs_meter_free(ubs_meter* meter);
/* Compares two images of shape (height, width, 3). Their values are clamped to the range from 0 to 1. */
UBS_API ubs_status ubs_meter_compare(ubs_meter* meter, int32_t width, int32_t height, const float* truth,
                                     const float* image, ubs_metrics* metrics);

#ifdef __cplusplus
}
#endif

#endif /* UBS_UBS_H */
