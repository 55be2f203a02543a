// SPDX-License-Identifier: Apache-2.0
// A replacement for the library NVRTC. Its only function returns the version UBS_STUB_MAJOR.2.
extern "C" int nvrtcVersion(int* major, int* minor);
int nvrtcVersion(int* major, int* minor) {
  *major = UBS_STUB_MAJOR;
  *minor = 2;
  return 0;
}
