# drake_srg in a container: docker build -t drake_srg .
# `docker run -v "$PWD:/work" drake_srg` runs the demo and leaves its replay in out/.
FROM debian:trixie-slim

# Python, and the libraries that Drake's wheel needs but does not contain.
RUN apt-get update && \
    apt-get install -y --no-install-recommends \
        ca-certificates python3 python3-venv libglib2.0-0 libegl1 libgl1 && \
    rm -rf /var/lib/apt/lists/*

WORKDIR /src
COPY . .
# Without isolation, the build too takes what is pinned.
RUN python3 -m venv /opt/drake_srg && \
    /opt/drake_srg/bin/pip install --no-cache-dir -c requirements.lock hatchling && \
    /opt/drake_srg/bin/pip install --no-cache-dir -c requirements.lock \
        --no-build-isolation .

ENV PATH=/opt/drake_srg/bin:$PATH
RUN drake-srg doctor

WORKDIR /work
ENTRYPOINT ["drake-srg"]
CMD ["demo"]
