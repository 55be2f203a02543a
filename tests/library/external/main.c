/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <ubs/ubs.h>

int main(void) {
  size_t count = 0, i;
  if (ubs_device_count(&count) != UBS_OK) {
    fprintf(stderr, "%s\n", ubs_error_message());
    return 1;
  }
  printf("ubs %s, %zu devices\n", ubs_version(), count);
  for (i = 0; i < count; ++i) {
    ubs_device_info info = {sizeof info};
    if (ubs_device_describe(i, &info) == UBS_OK) printf("  %s (%s)\n", info.name, info.platform);
  }
  return count > 0 ? 0 : 1;
}
