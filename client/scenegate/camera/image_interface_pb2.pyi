from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Time(_message.Message):
    __slots__ = ("sec", "nsec")
    SEC_FIELD_NUMBER: _ClassVar[int]
    NSEC_FIELD_NUMBER: _ClassVar[int]
    sec: int
    nsec: int
    def __init__(self, sec: _Optional[int] = ..., nsec: _Optional[int] = ...) -> None: ...

class Gpios(_message.Message):
    __slots__ = ("inputs", "outputs", "values")
    INPUTS_FIELD_NUMBER: _ClassVar[int]
    OUTPUTS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    inputs: int
    outputs: int
    values: int
    def __init__(self, inputs: _Optional[int] = ..., outputs: _Optional[int] = ..., values: _Optional[int] = ...) -> None: ...

class Image(_message.Message):
    __slots__ = ("timestamp", "height", "width", "focal_length", "principal_point_u", "principal_point_v", "encoding", "is_bigendian", "step", "data", "gpios", "exposure_time", "gain", "noise", "out1_reduction", "brightness", "gamma", "auto_exposure_adapting")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    FOCAL_LENGTH_FIELD_NUMBER: _ClassVar[int]
    PRINCIPAL_POINT_U_FIELD_NUMBER: _ClassVar[int]
    PRINCIPAL_POINT_V_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    IS_BIGENDIAN_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    GPIOS_FIELD_NUMBER: _ClassVar[int]
    EXPOSURE_TIME_FIELD_NUMBER: _ClassVar[int]
    GAIN_FIELD_NUMBER: _ClassVar[int]
    NOISE_FIELD_NUMBER: _ClassVar[int]
    OUT1_REDUCTION_FIELD_NUMBER: _ClassVar[int]
    BRIGHTNESS_FIELD_NUMBER: _ClassVar[int]
    GAMMA_FIELD_NUMBER: _ClassVar[int]
    AUTO_EXPOSURE_ADAPTING_FIELD_NUMBER: _ClassVar[int]
    timestamp: Time
    height: int
    width: int
    focal_length: float
    principal_point_u: float
    principal_point_v: float
    encoding: str
    is_bigendian: bool
    step: int
    data: bytes
    gpios: Gpios
    exposure_time: float
    gain: float
    noise: float
    out1_reduction: float
    brightness: float
    gamma: float
    auto_exposure_adapting: bool
    def __init__(self, timestamp: _Optional[_Union[Time, _Mapping]] = ..., height: _Optional[int] = ..., width: _Optional[int] = ..., focal_length: _Optional[float] = ..., principal_point_u: _Optional[float] = ..., principal_point_v: _Optional[float] = ..., encoding: _Optional[str] = ..., is_bigendian: bool = ..., step: _Optional[int] = ..., data: _Optional[bytes] = ..., gpios: _Optional[_Union[Gpios, _Mapping]] = ..., exposure_time: _Optional[float] = ..., gain: _Optional[float] = ..., noise: _Optional[float] = ..., out1_reduction: _Optional[float] = ..., brightness: _Optional[float] = ..., gamma: _Optional[float] = ..., auto_exposure_adapting: bool = ...) -> None: ...

class DisparityImage(_message.Message):
    __slots__ = ("timestamp", "scale", "offset", "invalid_data_value", "baseline", "delta_d", "image")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    INVALID_DATA_VALUE_FIELD_NUMBER: _ClassVar[int]
    BASELINE_FIELD_NUMBER: _ClassVar[int]
    DELTA_D_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    timestamp: Time
    scale: float
    offset: float
    invalid_data_value: float
    baseline: float
    delta_d: float
    image: Image
    def __init__(self, timestamp: _Optional[_Union[Time, _Mapping]] = ..., scale: _Optional[float] = ..., offset: _Optional[float] = ..., invalid_data_value: _Optional[float] = ..., baseline: _Optional[float] = ..., delta_d: _Optional[float] = ..., image: _Optional[_Union[Image, _Mapping]] = ...) -> None: ...

class Mesh(_message.Message):
    __slots__ = ("timestamp", "format", "data")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    timestamp: Time
    format: str
    data: bytes
    def __init__(self, timestamp: _Optional[_Union[Time, _Mapping]] = ..., format: _Optional[str] = ..., data: _Optional[bytes] = ...) -> None: ...

class ImageSet(_message.Message):
    __slots__ = ("timestamp", "left", "right", "disparity", "disparity_error", "confidence", "mesh", "color_camera", "depth_mm")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    LEFT_FIELD_NUMBER: _ClassVar[int]
    RIGHT_FIELD_NUMBER: _ClassVar[int]
    DISPARITY_FIELD_NUMBER: _ClassVar[int]
    DISPARITY_ERROR_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    MESH_FIELD_NUMBER: _ClassVar[int]
    COLOR_CAMERA_FIELD_NUMBER: _ClassVar[int]
    DEPTH_MM_FIELD_NUMBER: _ClassVar[int]
    timestamp: Time
    left: Image
    right: Image
    disparity: DisparityImage
    disparity_error: Image
    confidence: Image
    mesh: Mesh
    color_camera: Image
    depth_mm: Image
    def __init__(self, timestamp: _Optional[_Union[Time, _Mapping]] = ..., left: _Optional[_Union[Image, _Mapping]] = ..., right: _Optional[_Union[Image, _Mapping]] = ..., disparity: _Optional[_Union[DisparityImage, _Mapping]] = ..., disparity_error: _Optional[_Union[Image, _Mapping]] = ..., confidence: _Optional[_Union[Image, _Mapping]] = ..., mesh: _Optional[_Union[Mesh, _Mapping]] = ..., color_camera: _Optional[_Union[Image, _Mapping]] = ..., depth_mm: _Optional[_Union[Image, _Mapping]] = ...) -> None: ...

class MeshOptions(_message.Message):
    __slots__ = ("max_points", "binning_method", "watertight", "textured")
    class BinningMethod(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        AVERAGE: _ClassVar[MeshOptions.BinningMethod]
        MIN_DEPTH: _ClassVar[MeshOptions.BinningMethod]
    AVERAGE: MeshOptions.BinningMethod
    MIN_DEPTH: MeshOptions.BinningMethod
    MAX_POINTS_FIELD_NUMBER: _ClassVar[int]
    BINNING_METHOD_FIELD_NUMBER: _ClassVar[int]
    WATERTIGHT_FIELD_NUMBER: _ClassVar[int]
    TEXTURED_FIELD_NUMBER: _ClassVar[int]
    max_points: int
    binning_method: MeshOptions.BinningMethod
    watertight: bool
    textured: bool
    def __init__(self, max_points: _Optional[int] = ..., binning_method: _Optional[_Union[MeshOptions.BinningMethod, str]] = ..., watertight: bool = ..., textured: bool = ...) -> None: ...

class ImageSetRequest(_message.Message):
    __slots__ = ("left_enabled", "right_enabled", "disparity_enabled", "disparity_error_enabled", "confidence_enabled", "mesh_enabled", "mesh_options", "color", "color_camera_enabled", "depth_mm_enabled", "depth_aligned")
    LEFT_ENABLED_FIELD_NUMBER: _ClassVar[int]
    RIGHT_ENABLED_FIELD_NUMBER: _ClassVar[int]
    DISPARITY_ENABLED_FIELD_NUMBER: _ClassVar[int]
    DISPARITY_ERROR_ENABLED_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_ENABLED_FIELD_NUMBER: _ClassVar[int]
    MESH_ENABLED_FIELD_NUMBER: _ClassVar[int]
    MESH_OPTIONS_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    COLOR_CAMERA_ENABLED_FIELD_NUMBER: _ClassVar[int]
    DEPTH_MM_ENABLED_FIELD_NUMBER: _ClassVar[int]
    DEPTH_ALIGNED_FIELD_NUMBER: _ClassVar[int]
    left_enabled: bool
    right_enabled: bool
    disparity_enabled: bool
    disparity_error_enabled: bool
    confidence_enabled: bool
    mesh_enabled: bool
    mesh_options: MeshOptions
    color: bool
    color_camera_enabled: bool
    depth_mm_enabled: bool
    depth_aligned: bool
    def __init__(self, left_enabled: bool = ..., right_enabled: bool = ..., disparity_enabled: bool = ..., disparity_error_enabled: bool = ..., confidence_enabled: bool = ..., mesh_enabled: bool = ..., mesh_options: _Optional[_Union[MeshOptions, _Mapping]] = ..., color: bool = ..., color_camera_enabled: bool = ..., depth_mm_enabled: bool = ..., depth_aligned: bool = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("timestamp", "message")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    timestamp: Time
    message: str
    def __init__(self, timestamp: _Optional[_Union[Time, _Mapping]] = ..., message: _Optional[str] = ...) -> None: ...

class ImageEvents(_message.Message):
    __slots__ = ("imageset_timestamp", "depth_acquisition_done")
    IMAGESET_TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    DEPTH_ACQUISITION_DONE_FIELD_NUMBER: _ClassVar[int]
    imageset_timestamp: Time
    depth_acquisition_done: Event
    def __init__(self, imageset_timestamp: _Optional[_Union[Time, _Mapping]] = ..., depth_acquisition_done: _Optional[_Union[Event, _Mapping]] = ...) -> None: ...

class ImageEventsRequest(_message.Message):
    __slots__ = ("depth_acquisition_done_enabled",)
    DEPTH_ACQUISITION_DONE_ENABLED_FIELD_NUMBER: _ClassVar[int]
    depth_acquisition_done_enabled: bool
    def __init__(self, depth_acquisition_done_enabled: bool = ...) -> None: ...
