"""Serves Drake's render endpoint on a Ray cluster: replicas come and go with the requests.

    pip install ./client '.[ray]'    # in a checkout; 'scenegate[ray]' where the package is on the index
    python examples/ray_serve.py [--address auto] [--port 8000] [--most 8]

Every replica is a whole gateway that runs nothing but ``/render`` (and ``/healthz``, ``/readyz``, ``/metrics``), on one
core. Rendering keeps nothing between requests but caches, so any replica may answer any of them. Set
``RAY_SERVE_ENABLE_HA_PROXY=1`` (``pip install 'ray[haproxy]'``) when 60 requests a second do not do: Ray's own proxy
is written in Python.
"""

import argparse
import signal

import ray
from ray import serve

parser = argparse.ArgumentParser()
parser.add_argument("--address", help="of the cluster; without it one is started on this machine")
parser.add_argument("--host", default="127.0.0.1")
parser.add_argument("--port", type=int, default=8000)
parser.add_argument("--most", type=int, default=8, help="replicas")
arguments = parser.parse_args()


def gateway():
    """The application; called in every replica."""
    from gateway.runtime.kernels import cache

    cache.configure()  # before anything is imported that is compiled
    from gateway.app import create_app
    from gateway.runtime.settings import Settings

    # The queue is short: Ray gives a replica at most max_ongoing_requests, and holds back the others itself.
    return create_app(Settings(only=("render",), threads=1, queue=16))


render = serve.deployment(
    serve.ingress(gateway)(),
    name="render",
    ray_actor_options={"num_cpus": 1},
    max_ongoing_requests=4,
    graceful_shutdown_timeout_s=30,
    autoscaling_config={
        "min_replicas": 1,
        "max_replicas": arguments.most,
        "target_ongoing_requests": 2,  # one is drawn while the next is received
        "upscale_delay_s": 5,
        "downscale_delay_s": 120,  # a new replica has to load its kernels
    },
)

ray.init(arguments.address, include_dashboard=False) if arguments.address is None else ray.init(arguments.address)
serve.start(http_options={"host": arguments.host, "port": arguments.port})
serve.run(render.bind(), name="scenegate", route_prefix="/")
print(f"http://{arguments.host}:{arguments.port}/render", flush=True)
signal.sigwait({signal.SIGINT, signal.SIGTERM})
serve.shutdown()
ray.shutdown()
