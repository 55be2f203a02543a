# Debian 12 with PoCL: builds ubs as tools/setup.sh does. UNTESTED: there was no Docker where it was written.
#   docker build -t ubs . && docker run --rm ubs devices
#   docker run --rm --entrypoint tools/setup.sh ubs test     the tests, for CI elsewhere
FROM debian:12
WORKDIR /ubs
ENV UBS_GATES=off
COPY . .
# Root: the script installs what is missing. UBS_GATES=off: without the compilers for cards (tests/gates/README.md).
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates git && tools/setup.sh build && \
    cmake --install build --prefix /usr/local --component tools && \
    cmake --install build --prefix /usr/local --component library && ldconfig && rm -rf /var/lib/apt/lists/*
ENTRYPOINT ["ubs"]
