"""Write deploy/foxglove/layout.json, a layout of the Foxglove app: ``python -m tools.foxglove_layout``."""

import json
from pathlib import Path

import foxglove.layouts as fl

from scenegate.recording.topics import CLOUD_TOPIC, DISPARITY_TOPIC, IMAGE_TOPICS, SCENE_TOPIC
from scenegate.recording.values import WORLD

FILE = Path(__file__).parents[1] / "deploy" / "foxglove" / "layout.json"


def layout_text() -> str:
    """Return the layout as JSON: the scene with the camera's points, left image, depth, parameters."""
    scene = fl.ThreeDeePanel(
        title="Scene",
        config=fl.ThreeDeeConfig(
            follow_tf=WORLD,
            fixed_frame=WORLD,
            follow_mode="follow-none",
            layers={"grid": fl.BaseRendererGridLayerSettings()},
            topics={
                SCENE_TOPIC: fl.BaseRendererSceneUpdateTopicSettings(visible=True),
                CLOUD_TOPIC: fl.BaseRendererPointCloudTopicSettings(visible=True),
            },
        ),
    )
    depth = fl.ImageModeConfig(
        image_topic=IMAGE_TOPICS["depth"][0],
        calibration_topic=IMAGE_TOPICS["depth"][1],
        color_mode="colormap",
        color_map="turbo",
        min_value=0.0,
        max_value=5.0,
    )
    left = fl.ImageModeConfig(image_topic=IMAGE_TOPICS["left"][0], calibration_topic=IMAGE_TOPICS["left"][1])
    side = (
        fl.ImagePanel(title="Left", config=fl.ImageConfig(image_mode=left)),
        fl.ImagePanel(title=f"Depth in metres, see also {DISPARITY_TOPIC}", config=fl.ImageConfig(image_mode=depth)),
        fl.ParametersPanel(),
    )
    column = fl.SplitContainer(direction="column", items=[fl.SplitItem(content=panel) for panel in side])
    layout = fl.Layout(
        content=fl.SplitContainer(
            items=[fl.SplitItem(proportion=2.0, content=scene), fl.SplitItem(proportion=1.0, content=column)]
        )
    )
    return json.dumps(json.loads(layout.to_json()), indent=2) + "\n"


if __name__ == "__main__":
    FILE.write_text(layout_text())
