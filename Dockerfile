# Two stages: a virtual environment with the pinned dependencies and compiled kernels, then a slim image with it.
#
#   docker build -t scenegate .
#   docker build -t scenegate --secret id=ca,src=/etc/ssl/certs/ca-certificates.crt .   # behind a proxy with its own CA

FROM python:3.11-slim-bookworm AS build

ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
WORKDIR /src
COPY requirements.lock requirements-tools.lock ./
RUN --mount=type=secret,id=ca \
    if [ -f /run/secrets/ca ]; then export PIP_CERT=/run/secrets/ca SSL_CERT_FILE=/run/secrets/ca; fi \
 && python -m venv /opt/scenegate \
 && python -m venv /opt/tools \
 && /opt/tools/bin/pip install --quiet --require-hashes -r requirements-tools.lock \
 && /opt/scenegate/bin/pip install --quiet --require-hashes -r requirements.lock
COPY pyproject.toml README.md LICENSE ./
COPY gateway gateway
COPY renderers renderers
RUN /opt/tools/bin/python -m hatchling build -t wheel -d /tmp/wheel \
 && /opt/scenegate/bin/pip install --quiet --no-deps --no-index /tmp/wheel/*.whl

FROM python:3.11-slim-bookworm

# LCM's library needs glib.
RUN apt-get update \
 && apt-get install -y --no-install-recommends libglib2.0-0 \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --create-home --uid 10001 scenegate \
 && install -d -o scenegate /var/cache/scenegate
COPY --from=build /opt/scenegate /opt/scenegate
ENV PATH=/opt/scenegate/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    SCENEGATE_CACHE_DIR=/var/cache/scenegate \
    SCENEGATE_HOST=0.0.0.0
USER scenegate
# Kernels for the CPU of the building machine; on another kind of CPU the first start compiles them once more.
RUN scenegate warmup
EXPOSE 8000 7700 50051
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=3s --start-period=120s --retries=3 \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/readyz', timeout=2)"]
ENTRYPOINT ["scenegate"]
CMD ["serve"]
