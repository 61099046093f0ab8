# Two stages: a virtual environment with the pinned dependencies, then a slim image with it and the compiled kernels.
#
#   make image                    or: docker build -t scenegate .
#   docker build -t scenegate --secret id=ca,src=/etc/ssl/certs/ca-certificates.crt .   # behind a proxy with its own CA
#
# Needs BuildKit (Docker 23 and newer have it on; before that DOCKER_BUILDKIT=1) or Podman.

# By digest (an index of amd64, arm64 and others), which Dependabot renews.
FROM python:3.11-slim-bookworm@sha256:0bee7276f83efd4a1ee05bbbf4281d95ed28e079220a9457f25a93e3f1e3c31b AS base

FROM base AS build

ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 UV_NO_CACHE=1 UV_LINK_MODE=copy
WORKDIR /src
COPY requirements.lock requirements-tools.lock ./
# The tests of the libraries stay out: 40 MB that nobody runs. Bytecode goes in: the user that serves may not write it.
RUN --mount=type=secret,id=ca \
    if [ -f /run/secrets/ca ]; then export PIP_CERT=/run/secrets/ca SSL_CERT_FILE=/run/secrets/ca; fi \
 && python -m venv --without-pip /opt/scenegate \
 && python -m venv /opt/tools \
 && /opt/tools/bin/pip install --quiet --require-hashes -r requirements-tools.lock \
 && /opt/tools/bin/uv pip install --quiet --python /opt/scenegate/bin/python --require-hashes -r requirements.lock \
 && find /opt/scenegate/lib -type d -name tests -prune -exec rm -rf {} + \
 && python -m compileall -q -j 0 /opt/scenegate/lib
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY client client
COPY gateway gateway
COPY renderers renderers
RUN (cd client && /opt/tools/bin/python -m hatchling build -t wheel -d ../dist) \
 && /opt/tools/bin/python -m hatchling build -t wheel -d dist \
 && /opt/tools/bin/uv pip install --quiet --python /opt/scenegate/bin/python --no-deps --offline --compile-bytecode \
    dist/*.whl

FROM base

# LCM's library needs glib.
RUN apt-get update \
 && apt-get install -y --no-install-recommends libglib2.0-0 \
 && apt-get clean \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt /var/log/apt /var/log/dpkg.log \
 && useradd --create-home --uid 10001 scenegate \
 && install -d -o scenegate /var/cache/scenegate /var/lib/scenegate
COPY --from=build /opt/scenegate /opt/scenegate
ENV PATH=/opt/scenegate/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    SCENEGATE_CACHE_DIR=/var/cache/scenegate \
    SCENEGATE_HOST=0.0.0.0
USER scenegate
# Kernels for the CPU of the building machine. On another kind of CPU the first start compiles them once more, into /tmp if
# this folder is read-only.
RUN scenegate warmup
EXPOSE 8000 7700 50051
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=3s --start-period=120s --retries=3 \
    CMD ["python", "-m", "gateway.runtime.http.healthcheck"]
ENTRYPOINT ["scenegate"]
CMD ["serve"]
