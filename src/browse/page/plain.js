// Frames as they come, for a browser without WebGL2.

export class Plain {
  constructor(canvas) {
    this.paint = canvas.getContext("2d", { alpha: false });
    this.frames = [];
  }

  take({ image, pose, points, ...about }) {
    this.frames[0]?.image.close();
    this.frames = [{ ...about, image, pose, width: image.width, height: image.height, middle: points.middle, tangent: [1, 1] }];
    return this.frames[0];
  }

  draw(_pose, [frame]) {
    const { width, height } = this.paint.canvas;
    if (frame) this.paint.drawImage(frame.image, 0, 0, width, height);
  }
}
