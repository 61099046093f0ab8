"""OpenAPI description of the node routes: parameters, bodies, responses and examples."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import Path, Query
from pydantic import Field

from gateway.adapters.stereo.device.parameter_specs import NODE_ALIASES, NODES, Spec
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.routes import device_content as device
from gateway.adapters.stereo.routes.rest_common import error_responses
from gateway.runtime.http.openapi import Responses, example, json_example

_SPECS: Final[dict[str, Spec]] = {name: spec for specs in NODES.values() for name, spec in specs.items()}
"""Parameters of all nodes by name. No two nodes have a parameter of the same name."""
_SERVICE_NAMES: Final = list(dict.fromkeys(name for services in device.SERVICES.values() for name in services))

# The enums describe the names, but do not validate them. For unknown names, the handlers return 404 as the device does;
# FastAPI would return 422. Swagger UI fills its form with the default of an enum, not with the example.
NodeName = Annotated[
    str,
    Path(
        description="Name of a node",
        json_schema_extra={"enum": [*NODES, *NODE_ALIASES], "default": "rc_stereomatching"},
        openapi_examples=example("rc_stereomatching"),
    ),
]
ParameterName = Annotated[
    str,
    Path(
        description="Name of a parameter of the node",
        json_schema_extra={"enum": list(_SPECS), "default": "quality"},
        openapi_examples=example("quality"),
    ),
]
ParameterNames = Annotated[
    list[Annotated[str, Field(json_schema_extra={"enum": list(_SPECS)})]],
    Query(
        alias="name",
        description="Names of the parameters to return; by default all of the node",
        openapi_examples=example(["quality"]),
    ),
]
ServiceName = Annotated[
    str,
    Path(
        description="Name of a service of the node",
        json_schema_extra={"enum": _SERVICE_NAMES, "default": "reset_defaults"},
        openapi_examples=example("reset_defaults"),
    ),
]


def node_errors(*statuses: int) -> Responses:
    """Return the error responses of a node's route."""
    descriptions = {
        400: "Invalid body or value; the message names the parameter and the limit.",
        404: "There is no such node, parameter or service.",
        413: "The body is too large.",
        507: "The values are set, but could not be stored (--state).",
    }
    return error_responses({status: descriptions[status] for status in statuses})


def _value_schema(spec: Spec) -> dict[str, Any]:
    if spec.type == "string":
        return {"type": "string", "enum": [*spec.choices, *spec.aliases]}
    if spec.type == "bool":
        return {"type": ["boolean", "integer"], "minimum": 0, "maximum": 1}
    kind = "integer" if spec.type == "int32" else "number"
    return {"type": kind, "minimum": spec.minimum, "maximum": spec.maximum}


def _assignment_schema(spec: Spec) -> dict[str, Any]:
    return {
        "type": "object",
        "title": spec.name,
        "description": spec.description,
        "required": ["name", "value"],
        "properties": {"name": {"const": spec.name}, "value": _value_schema(spec)},
    }


def _body(schema: dict[str, Any], example_body: Any, description: str, *, required: bool) -> dict[str, Any]:
    """Return the description of a body that the handler decodes itself."""
    content = {"application/json": {"schema": schema, "examples": example(example_body)}}
    return {"requestBody": {"required": required, "description": description, "content": content}}


ASSIGNMENTS_BODY: Final = _body(
    {"type": "array", "items": {"anyOf": [_assignment_schema(spec) for spec in _SPECS.values()]}},
    [{"name": "quality", "value": "High"}, {"name": "minconf", "value": 0.6}],
    "Parameters of the node. Optional: parameters in the query, as in ?quality=High&minconf=0.6, are set as well.",
    required=False,
)
VALUE_BODY: Final = _body(
    {
        "type": "object",
        "required": ["value"],
        "properties": {
            "value": {
                "type": ["number", "string", "boolean"],
                "description": "A value of the parameter's type and within its limits, as shown by GET.",
            }
        },
    },
    {"value": "High"},
    "The value. ?value=High in the query has the same effect without a body.",
    required=True,
)
CALL_BODY: Final = _body(
    {
        "type": "object",
        "properties": {"args": {"type": ["object", "null"], "description": "Only `measure_depth` has arguments."}},
    },
    {"args": {}},
    "Arguments of the call.",
    required=False,
)

_NODE: Final = device.node_info("rc_stereomatching")
_STATUS: Final = {
    "status": "running",
    "timestamp": 1700000000.04,
    "values": {"fps": "25", "width": "640", "height": "480"},
}
_QUALITY: Final = Parameters().describe("rc_stereomatching", "quality")
_MINCONF: Final = {**Parameters().describe("rc_stereomatching", "minconf"), "value": 0.6}
_SERVICE: Final = device.service_info("rc_stereomatching", "reset_defaults")

NODES_RESPONSE: Final = json_example([_NODE])
NODE_RESPONSE: Final = json_example(_NODE)
STATUS_RESPONSE: Final = json_example(_STATUS)
PARAMETERS_RESPONSE: Final = json_example([_QUALITY])
ASSIGNED_RESPONSE: Final = json_example([_QUALITY, _MINCONF])
PARAMETER_RESPONSE: Final = json_example(_QUALITY)
SERVICES_RESPONSE: Final = json_example([_SERVICE])
SERVICE_RESPONSE: Final = json_example(_SERVICE)
CALL_RESPONSE: Final = json_example(
    {"name": "reset_defaults", "response": {"return_code": {"value": 0, "message": ""}}}
)
