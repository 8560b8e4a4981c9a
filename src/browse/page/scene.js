// The scene that the page shows, of a service with several: ?scene=NAME in the page's address, else the first one.

const name = new URLSearchParams(location.search).get("scene");
const word = name === null ? "" : `scene=${encodeURIComponent(name)}`;

// A path of the page's server, for this scene.
export const ofScene = path => word ? `${path}${path.includes("?") ? "&" : "?"}${word}` : path;

// Offers all scenes by their names, of which the page shows one. Another one is another page.
export function offerScenes(box, names, shown) {
  box.parentElement.hidden = names.length < 2;
  names.forEach(each => box.add(new Option(each, each, false, each === shown)));
  box.addEventListener("change", () => {
    const words = new URLSearchParams(location.search);
    words.set("scene", box.value);
    location.assign(`?${words}`);
  });
}
