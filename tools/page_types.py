"""Write the page's types of messages, ``web/src/protocol.ts``, from ``gateway.adapters.viewer.messages``.

    python -m tools.page_types gateway/adapters/viewer/web/src/protocol.ts

A struct becomes an interface; a field with a default is optional, because messages leave it out.
"""

import argparse
from pathlib import Path
from typing import Any, get_args

from msgspec import inspect
from msgspec.inspect import StructType

from gateway.adapters.viewer import messages
from gateway.scene.tree.nodes import Path as NodePath
from scenegate.messages import controls

HEAD = "// Written by `make check-web` from gateway/adapters/viewer/messages.py, which describes the fields.\n"
ALIASES = {"Vector": messages.Vector, "Path": NodePath, "ControlValue": controls.Value}
PRIMITIVES: dict[type, str] = {
    inspect.IntType: "number",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
    inspect.NoneType: "null",
    inspect.AnyType: "unknown",
}


class Writer:
    """Collects declarations: the interface of a struct, and those of the structs in its fields."""

    def __init__(self) -> None:
        self.declarations: dict[str, str] = {}
        self._aliases: dict[str, str] = {}  # by repr, since types are not hashable

    def alias(self, name: str, type_: Any) -> None:
        """Declare a name of a type."""
        info = inspect.type_info(type_)
        self.declarations[name] = f"export type {name} = {self.text(info)};"
        self._aliases[repr(info)] = name

    def text(self, info: inspect.Type) -> str:
        """Return a type in TypeScript.

        Raises:
            TypeError: there is no rule for the type.
        """
        if repr(info) in self._aliases:
            return self._aliases[repr(info)]
        match info:
            case inspect.Metadata(extra_json_schema={"typescript": str(text)}):
                return text
            case inspect.Metadata():
                return self.text(info.type)
            case inspect.LiteralType():
                return " | ".join(f'"{each}"' if isinstance(each, str) else str(each) for each in info.values)
            case inspect.UnionType():
                return " | ".join(dict.fromkeys(map(self.text, info.types)))
            case inspect.ListType() | inspect.VarTupleType():
                item = self.text(info.item_type)
                return f"({item})[]" if " | " in item else f"{item}[]"
            case inspect.TupleType():
                return f"[{', '.join(map(self.text, info.item_types))}]"
            case inspect.DictType():
                return f"Record<string, {self.text(info.value_type)}>"
            case StructType():
                self.interface(info)
                return info.cls.__name__
        if type(info) in PRIMITIVES:
            return PRIMITIVES[type(info)]
        raise TypeError(f"there is no rule for {info}")

    def interface(self, info: StructType) -> None:
        """Declare the interface of a struct."""
        if info.cls.__name__ not in self.declarations:
            tag = {} if info.tag is None else {str(info.tag_field): f'"{info.tag}"'}
            fields = {self._key(field, optional=not field.required): self._field(field) for field in info.fields}
            self._declare(info.cls.__name__, tag | fields)

    def merged(self, name: str, infos: list[StructType], **more: str) -> None:
        """Declare an interface for all of several structs. Fields that a struct may not have are optional."""
        tags = " | ".join(f'"{info.tag}"' for info in infos)
        required = set.intersection(*({field.name for field in info.fields if field.required} for info in infos))
        fields = {
            self._key(field, optional=field.name not in required): self._field(field)
            for info in infos
            for field in info.fields
            if field.name not in more
        }
        self._declare(name, {str(infos[0].tag_field): tags} | more | fields)

    def _declare(self, name: str, fields: dict[str, str]) -> None:
        lines = [f"  {field}: {text};" for field, text in fields.items()]
        self.declarations[name] = "\n".join([f"export interface {name} {{", *lines, "}"])

    def _key(self, field: inspect.Field, *, optional: bool) -> str:
        return f"{field.encode_name}?" if optional else field.encode_name

    def _field(self, field: inspect.Field) -> str:
        type_ = field.type
        if field.default is None and isinstance(type_, inspect.UnionType):  # None is left out
            type_ = inspect.UnionType(tuple(each for each in type_.types if not isinstance(each, inspect.NoneType)))
        return self.text(type_)


def page_types() -> str:
    """Return the module of types."""
    writer = Writer()
    for name, type_ in ALIASES.items():
        writer.alias(name, type_)
    structs = [info for info in map(inspect.type_info, get_args(controls.AnyControl)) if isinstance(info, StructType)]
    writer.merged("ControlDefinition", structs, id="number", value="ControlValue")
    for struct in (*messages.MESSAGES, *messages.RECORDED, *messages.RESPONSES, *messages.REPORTS):
        writer.text(inspect.type_info(struct))
    message = "".join(f"\n  | {each.__name__}" for each in messages.MESSAGES)
    return "\n\n".join([HEAD.rstrip(), *writer.declarations.values(), f"export type Message ={message};\n"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.parse_args().file.write_text(page_types())
