import { Box3, PerspectiveCamera, Vector3 } from "three";
import { expect, it } from "vitest";
import { frame } from "../src/view/camera";

const UP = new Vector3(0, 0, 1);

it.each([0.5, 1, 2.5])("frames boxes in the middle in a view of aspect %d", (aspect) => {
  const boxes = [new Box3(new Vector3(-1, -1, 0), new Vector3(1, 1, 1)), new Box3(new Vector3(5, 0, 0), new Vector3(6, 1, 4))];
  const direction = new Vector3(1, -1.2, 0.8).normalize();
  const camera = new PerspectiveCamera(45, aspect, 0.01, 1000);
  const { position, target } = frame(boxes, direction, UP, Math.tan(Math.PI / 8), aspect);
  camera.up.copy(UP);
  camera.position.copy(position);
  camera.lookAt(target);
  camera.updateMatrixWorld();
  const seen = boxes.flatMap(({ min, max }) =>
    [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new Vector3(x, y, z).project(camera)))),
  );
  const extent = (values: number[]) => [Math.min(...values), Math.max(...values)] as const;
  const [left, right] = extent(seen.map(({ x }) => x));
  const [bottom, top] = extent(seen.map(({ y }) => y));
  expect(Math.max(right, -left, top, -bottom)).toBeCloseTo(1 / 1.12, 5);
  expect(Math.min(Math.abs(right + left), Math.abs(top + bottom))).toBeCloseTo(0, 5);
});
