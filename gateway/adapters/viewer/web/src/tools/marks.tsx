// Axes and names of nodes over the scene, and their choices in the details panel. Axes have the same size at any distance.

import { AxesHelper, type Camera, LineSegments, Object3D, Vector3 } from "three";
import type { Mark, Model, TreeNode } from "../model";
import { Check } from "../widgets/controls";

/** Number of nodes up to which marks are shown. */
export const MAX_MARKS = 500;
/** Length of an axis as a fraction of the view's height. */
const LENGTH = 0.06;

/** Return the visible nodes that have marks, with what is shown of them; at most `MAX_MARKS`. */
export function markedNodes(model: Model): [TreeNode, Omit<Mark, "below">][] {
  const found: [TreeNode, Omit<Mark, "below">][] = [];
  const stack: [TreeNode, Omit<Mark, "below">][] = [[model.root, { axes: false, name: false }]];
  for (let entry = stack.pop(); entry && found.length < MAX_MARKS; entry = stack.pop()) {
    const [node, inherited] = entry;
    if (!node.isShown) continue;
    const { mark } = node;
    const own = { axes: inherited.axes || mark?.axes === true, name: inherited.name || mark?.name === true };
    if (own.axes || own.name) found.push([node, own]);
    for (const child of node.children) stack.push([child, mark?.below ? own : inherited]);
  }
  return found;
}

export class Marks {
  /** Axes, in the page's scene. */
  readonly object = new Object3D();
  private readonly labels = Object.assign(document.createElement("div"), { className: "marks" });
  /** Axes of one metre, seen through everything. */
  private readonly shape = new AxesHelper(1);
  private readonly marks = new Map<TreeNode, { axes: LineSegments | null; label: HTMLElement | null }>();

  /** @param origin point of the world at which the page's scene has its origin */
  constructor(
    private readonly model: Model,
    private readonly origin: Vector3,
    holder: HTMLElement,
  ) {
    holder.append(this.labels);
    Object.assign(this.shape.material, { depthTest: false, transparent: true });
  }

  /** Make the marks again, after nodes or choices changed. */
  refresh(): void {
    this.object.clear();
    this.marks.clear();
    for (const [node, { axes, name }] of markedNodes(this.model))
      this.marks.set(node, {
        axes: axes ? this.newAxes() : null,
        label: name ? Object.assign(document.createElement("span"), { textContent: node.shownName }) : null,
      });
    this.labels.replaceChildren(...[...this.marks.values()].flatMap(({ label }) => label ?? []));
    this.move();
  }

  /** Place the axes where the nodes are. */
  move(): void {
    for (const [node, { axes }] of this.marks)
      if (axes) {
        node.world.decompose(axes.position, axes.quaternion, new Vector3());
        axes.position.sub(this.origin);
      }
  }

  /** Place the names in a view of a size in pixels. */
  placeNames(camera: Camera, width: number, height: number): void {
    for (const [node, { label }] of this.marks) {
      if (!label) continue;
      const at = new Vector3().setFromMatrixPosition(node.world).sub(this.origin).project(camera);
      label.hidden = !(Math.abs(at.z) < 1);
      label.style.translate = `${((at.x + 1) / 2) * width}px ${((1 - at.y) / 2) * height}px`;
    }
  }

  /** Draw the names into an image of the view, with `ratio` pixels per CSS pixel. */
  drawNames(context: CanvasRenderingContext2D, ratio: number): void {
    const { left, top } = this.labels.getBoundingClientRect();
    context.scale(ratio, ratio);
    for (const label of this.labels.querySelectorAll<HTMLElement>("span:not([hidden])")) {
      const { x, y, width, height } = label.getBoundingClientRect();
      const { backgroundColor, color, font, paddingLeft } = getComputedStyle(label);
      Object.assign(context, { font, textBaseline: "middle", fillStyle: backgroundColor });
      context.fillRect(x - left, y - top, width, height);
      context.fillStyle = color;
      context.fillText(label.textContent, x - left + Number.parseFloat(paddingLeft), y - top + height / 2);
    }
  }

  private newAxes(): LineSegments {
    const axes = new LineSegments(this.shape.geometry, this.shape.material);
    Object.assign(axes, { frustumCulled: false, renderOrder: 1 });
    axes.onBeforeRender = (_renderer, _scene, camera) => scaleToView(axes, camera);
    this.object.add(axes);
    return axes;
  }
}

/** Give axes their length in the view of a camera. */
function scaleToView({ position, quaternion, matrixWorld }: Object3D, camera: Camera): void {
  const { elements } = camera.projectionMatrix;
  const [x, y, z, w] = [elements[3]!, elements[7]!, elements[11]!, elements[15]!];
  const seen = position.clone().applyMatrix4(camera.matrixWorldInverse);
  const depth = x * seen.x + y * seen.y + z * seen.z + w; // 1 in an orthographic view
  matrixWorld.compose(position, quaternion, new Vector3().setScalar((2 * LENGTH * Math.max(depth, 1e-6)) / elements[5]!));
}

const NO_MARK: Mark = { axes: false, name: false, below: false };
const CHOICES: [keyof Mark, string, string][] = [
  ["axes", "Axes", "Show the node's frame: x red, y green, z blue"],
  ["name", "Name", "Show the node's name"],
  ["below", "and below", "Show the same of all nodes below it"],
];

/** Axes and name of a node in the view. */
export function MarkFields({ node, changed }: { node: TreeNode; changed: () => void }) {
  const choose = (key: keyof Mark, on: boolean) => {
    const mark = { ...(node.mark ?? NO_MARK), [key]: on };
    node.mark = Object.values(mark).some(Boolean) ? mark : null;
    changed();
  };
  return (
    <div class="choices" role="group" aria-label="In the view">
      {CHOICES.map(([key, text, title]) => (
        <Check key={key} text={text} title={title} checked={node.mark?.[key] ?? false} onChange={(on) => choose(key, on)} />
      ))}
    </div>
  );
}
