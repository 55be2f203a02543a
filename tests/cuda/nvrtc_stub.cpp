// SPDX-License-Identifier: Apache-2.0
// A library that only reports that it is version UBS_STUB_MAJOR.2 of NVRTC.
extern "C" int nvrtcVersion(int* major, int* minor);
int nvrtcVersion(int* major, int* minor) {
  *major = UBS_STUB_MAJOR;
  *minor = 2;
  return 0;
}
