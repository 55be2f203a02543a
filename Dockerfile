# An image of Debian 12 with PoCL, in which tools/setup.sh builds ubs. This file is UNTESTED, because the machine on
# which it was written has no Docker.
#   docker build -t ubs . && docker run --rm ubs devices
#   docker run --rm --entrypoint tools/setup.sh ubs test     runs the tests, for example for CI on another machine
FROM debian:12
WORKDIR /ubs
ENV UBS_GATES=off
COPY . .
# These commands run as root, so tools/setup.sh can install missing packages. With UBS_GATES=off, it does not fetch the
# compilers for GPUs that some tests use (tests/gates/README.md).
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates git && tools/setup.sh build && \
    cmake --install build --prefix /usr/local --component tools && \
    cmake --install build --prefix /usr/local --component library && ldconfig && rm -rf /var/lib/apt/lists/*
ENTRYPOINT ["ubs"]
