import { expect, it } from "vitest";
import { Measurement, measured } from "../src/tools/measure";

it("says what is measured", () => {
  expect(measured([])).toEqual({ distance: "", details: "Click a point in the scene." });
  expect(measured([[1, 2, 3]])).toEqual({ distance: "", details: "1  2  3 m. Click a second point." });
  const far = measured([
    [500_000.25, 0, 0],
    [500_003.25, 0, -4],
  ]);
  expect(far).toEqual({ distance: "5 m", details: "Δ 3  0  -4 m", ends: ", from 500000.25  0  0 m, to 500003.25  0  -4 m" });
});

it("takes two points, and starts again with a third one", () => {
  let drawn = 0;
  const measurement = new Measurement(() => (drawn += 1));
  expect([measurement.stop(), measurement.object.visible]).toEqual([false, false]);
  measurement.toggle();
  measurement.add([500_000, 0, 1]);
  measurement.add([500_001, 0, 1]);
  expect(measurement.points.value).toHaveLength(2);
  expect([measurement.object.visible, measurement.object.position.x]).toEqual([true, 500_000]);
  measurement.add([7, 0, 0]);
  expect(measurement.points.value).toEqual([[7, 0, 0]]);
  expect(drawn).toBeGreaterThan(3);
  expect([measurement.stop(), measurement.points.value]).toEqual([true, null]);
});
