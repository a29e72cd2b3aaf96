"""A small neural network in numpy: two hidden layers of tanh, fitted by Adam. The examples share it; for larger ones use torch."""

import numpy as np

FLOOR, PIXEL_FLOOR = 0.02, 0.005
"""Inputs that vary by less (standard deviation) are not scaled up further; the second for pixels, most of which change little."""
PIXEL_DECAY = 10.0
"""Share of the rate by which the weights of pixels become smaller in each step: there are so many that a network could know its examples by their noise."""


def batches(count, size, random):
    """A random order of so many examples in batches of at most `size`, all of one size within one: a step of Adam down the gradient of a few examples is as long as any other, and mostly noise."""
    return np.array_split(random.permutation(count), -(-count // size))


class Network:
    """A function from rows of `inputs` numbers to rows of `outputs` numbers. The last `pixels` of the inputs begin without weight."""

    def __init__(self, inputs, outputs, hidden, random, pixels=0):
        sizes = [inputs, hidden, hidden, outputs]
        self.mean, self.scale = np.zeros(inputs, np.float32), np.ones(inputs, np.float32)
        self.weights = []
        for before, after in zip(sizes, sizes[1:]):
            bound = np.sqrt(1.0 / before)
            self.weights += [random.normal(0.0, bound, (before, after)).astype(np.float32), np.zeros(after, np.float32)]
        self.weights[-2] *= 0.1
        self.pixels = pixels
        self.weights[0][inputs - pixels :] = 0.0
        self.reset_adam()

    def reset_adam(self):
        self.first, self.second = ([np.zeros_like(w) for w in self.weights] for _ in range(2))
        self.count = 0

    def standardize(self, inputs):
        """Scales inputs to the spread of these rows."""
        floor = np.full(inputs.shape[1], FLOOR, np.float32)
        floor[inputs.shape[1] - self.pixels :] = PIXEL_FLOOR
        self.mean, self.scale = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), floor)

    def layers(self, inputs):
        layers = [np.clip((inputs - self.mean) / self.scale, -5.0, 5.0)]
        for n in range(0, len(self.weights), 2):
            sums = layers[-1] @ self.weights[n] + self.weights[n + 1]
            layers.append(np.tanh(sums) if n + 2 < len(self.weights) else sums)
        return layers

    def __call__(self, inputs):
        return self.layers(inputs)[-1]

    def gradients(self, layers, slope):
        """Gradients of the weights for a gradient of the outputs, with the layers of a call."""
        found = [None] * len(self.weights)
        for n in range(len(self.weights) - 2, -1, -2):
            found[n], found[n + 1] = layers[n // 2].T @ slope, slope.sum(axis=0)
            if n > 0:
                slope = (slope @ self.weights[n].T) * (1.0 - layers[n // 2] ** 2)
        return found

    def adam(self, gradients, rate):
        """A step of Adam down these gradients."""
        self.count += 1
        correction = np.sqrt(1.0 - 0.999**self.count) / (1.0 - 0.9**self.count)
        for weight, slope, first, second in zip(self.weights, gradients, self.first, self.second):
            first += 0.1 * (slope - first)
            second += 0.001 * (slope**2 - second)
            weight -= (rate * correction * first / (np.sqrt(second) + 1e-8)).astype(np.float32)
        self.weights[0][len(self.weights[0]) - self.pixels :] *= 1.0 - rate * PIXEL_DECAY

    def fit(self, inputs, outputs, epochs, random, batch=512, rate=1e-3, tell=None):
        """Fits by the mean squared error with a rate that falls to zero; returns the error of the last epoch."""
        self.reset_adam()
        error = np.inf
        for epoch in range(epochs):
            total = 0.0
            pace = rate * 0.5 * (1.0 + np.cos(np.pi * epoch / epochs))
            for chosen in batches(len(inputs), batch, random):
                layers = self.layers(inputs[chosen])
                wrong = layers[-1] - outputs[chosen]
                total += float((wrong**2).sum())
                self.adam(self.gradients(layers, 2.0 * wrong / len(chosen)), pace)
            error = total / outputs.size
            if tell and epoch % 10 == 9:
                tell(f"  epoch {epoch + 1}: mean squared error {error:.5f}")
        return error

    def fit_on_gpu(self, inputs, outputs, epochs, random, batch=4096, rate=2e-3):
        """`fit` with torch on a GPU, in batches that suit it."""
        import torch

        device = torch.device("cuda")
        mean, scale = (torch.tensor(value, device=device) for value in (self.mean, self.scale))
        rows = torch.clamp((torch.tensor(inputs, device=device) - mean) / scale, -5.0, 5.0)
        wanted = torch.tensor(outputs, device=device)
        weights = [torch.tensor(weight, device=device, requires_grad=True) for weight in self.weights]
        adam, error = torch.optim.Adam(weights, lr=rate), float("inf")
        parts = -(-len(rows) // batch)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, epochs * parts)
        generator = torch.Generator().manual_seed(int(random.integers(2**31)))
        for _ in range(epochs):
            order, total = torch.randperm(len(rows), generator=generator).to(device), 0.0
            for chosen in order.tensor_split(parts):
                layer = rows[chosen]
                for n in range(0, len(weights), 2):
                    layer = layer @ weights[n] + weights[n + 1]
                    layer = torch.tanh(layer) if n + 2 < len(weights) else layer
                loss = ((layer - wanted[chosen]) ** 2).mean()
                adam.zero_grad()
                loss.backward()
                adam.step()
                with torch.no_grad():
                    weights[0][len(weights[0]) - self.pixels :] *= 1.0 - falling.get_last_lr()[0] * PIXEL_DECAY
                falling.step()
                total += loss.detach() * len(chosen)
            error = float(total) / len(rows)
        self.weights = [weight.detach().cpu().numpy() for weight in weights]
        return error

    def save(self, file, **more):
        np.savez_compressed(file, mean=self.mean, scale=self.scale, pixels=self.pixels, **more, **{f"w{n}": w for n, w in enumerate(self.weights)})

    @staticmethod
    def load(data):
        """The network of a file that `save` wrote, as ``numpy.load`` reads it."""
        network = object.__new__(Network)
        network.mean, network.scale = data["mean"], data["scale"]
        network.weights, network.pixels = [data[f"w{n}"] for n in range(6)], int(data["pixels"])
        network.reset_adam()
        return network
