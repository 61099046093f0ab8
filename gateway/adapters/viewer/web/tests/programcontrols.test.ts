import { Matrix4, Quaternion, Vector3 } from "three";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { numbersOf, poseOf, poseOfNumbers } from "../src/programs/gizmopose";
import { curvePath, limits } from "../src/programs/plotview";
import { foldersOf, ProgramControls } from "../src/programs/programcontrols";
import type { ControlChange, ControlDefinition, PageControls } from "../src/protocol";

const SPEED: ControlDefinition = { id: 1, type: "slider", path: ["arm", "speed"], value: 1, min: 0, max: 10 };
const GO: ControlDefinition = { id: 2, type: "button", path: ["go"], value: 0 };
const PLOT: ControlDefinition = { id: 3, type: "plot", path: ["loads"], value: null, series: ["a"] };

function message(change: Partial<PageControls>): PageControls {
  return { kind: "controls", controls: null, values: [], samples: [], ...change };
}

describe("ProgramControls", () => {
  let sent: ControlChange[];
  let controls: ProgramControls;
  const at = (index: number) => controls.all.value[index]!;
  beforeEach(() => {
    vi.useFakeTimers();
    sent = [];
    controls = new ProgramControls((change) => sent.push(change));
    controls.receive(message({ controls: [SPEED, GO, PLOT] }));
  });
  afterEach(() => void vi.useRealTimers());

  it("shows values, and keeps them when other controls are added", () => {
    controls.receive(
      message({
        values: [
          [1, 5],
          [9, 1],
        ],
      }),
    );
    const { value } = at(0);
    controls.receive(message({ controls: [{ ...SPEED, value: 5, max: 20 }] }));
    expect(at(0).value).toBe(value);
    expect([value.value, at(0).definition.max, controls.all.value.length]).toEqual([5, 20, 1]);
  });

  it("sends the first change at once and the last of many", () => {
    for (const value of [2, 3, 4]) controls.set(at(0), value);
    expect(sent).toEqual([{ control: 1, number: 1, value: 2 }]);
    vi.runAllTimers();
    expect(sent.slice(1)).toEqual([{ control: 1, number: 2, value: 4 }]);
    controls.set(at(1), null);
    controls.set(at(1), null);
    expect(sent.slice(2)).toEqual([3, 4].map((number) => ({ control: 2, number, value: null })));
  });

  it("ignores values that are older than its last change", () => {
    controls.set(at(0), 2);
    controls.receive(message({ values: [[1, 7]] }));
    controls.set(at(0), 3);
    controls.received(1);
    controls.receive(message({ values: [[1, 2]] }));
    vi.runAllTimers();
    controls.receive(message({ values: [[1, 2]] }));
    expect(at(0).value.value).toBe(3);
    controls.received(2);
    controls.receive(message({ values: [[1, 6]] }));
    expect(at(0).value.value).toBe(6);
  });

  it("takes all values of a new connection", () => {
    controls.set(at(0), 2);
    controls.reset();
    expect(controls.all.value).toEqual([]);
    controls.receive(message({ controls: [SPEED] }));
    expect(at(0).value.value).toBe(1);
  });

  it("collects samples, and starts again when the time goes backwards", () => {
    const add = (...numbers: number[]) => controls.receive(message({ samples: [[3, Float64Array.from(numbers)]] }));
    add(1, 10, 2, 20);
    add(3, 30);
    expect(at(2).samples.value).toEqual([]);
    vi.runAllTimers();
    expect(at(2).samples.value).toEqual([
      [1, 10],
      [2, 20],
      [3, 30],
    ]);
    add(0, 5);
    add(...Array.from({ length: 6000 }, (_, i) => i / 2));
    vi.runAllTimers();
    expect([at(2).samples.value.length, at(2).samples.value.at(-1)?.[0]]).toEqual([2000, 2999]);
  });

  it("puts controls into folders", () => {
    const { controls: top, folders } = foldersOf(controls.all.value);
    expect(top.map(({ definition }) => definition.id)).toEqual([2, 3]);
    expect(folders.get("arm")?.controls.map(({ definition }) => definition.id)).toEqual([1]);
  });
});

describe("a plot", () => {
  it("has limits that are apart", () => {
    expect(limits([])).toEqual([0, 1]);
    expect(
      limits([
        [0, 1, Number.NaN],
        [1, 5, -2],
      ]),
    ).toEqual([-2, 5]);
    expect(limits([[0, 10]])).toEqual([9, 11]);
    expect(limits([[0, 0]])).toEqual([-1, 1]);
  });

  it("has gaps", () => {
    const rows = [
      [0, 0],
      [1, 1],
      [2, Number.NaN],
      [4, 1],
    ];
    expect(curvePath(rows, 1, 0, 4, 0, 1)).toBe("M0.0 110.0L80.0 0.0M320.0 0.0");
  });
});

describe("a gizmo", () => {
  it("has a pose in metres and degrees", () => {
    const numbers = [1, 2, 3, 10, -20, 30];
    const pose = poseOfNumbers(numbers);
    expect(numbersOf(pose)).toEqual(numbers.map((number) => expect.closeTo(number, 6)));
    const {
      translation,
      quaternion: [w, x, y, z],
    } = pose;
    const matrix = new Matrix4().compose(new Vector3(...translation), new Quaternion(x, y, z, w), new Vector3(1, 1, 1));
    expect(numbersOf(poseOf(matrix))).toEqual(numbers.map((number) => expect.closeTo(number, 6)));
  });
});
