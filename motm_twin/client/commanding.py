"""Every command of `bus.commands` as a typed method; the class of the handle defines the return type."""

from abc import abstractmethod
from typing import Generic, TypeVar

from motm_twin.bus import commands
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.edits import ParameterValue
from motm_twin.model.scene import Task

Result = TypeVar("Result")


class Commanding(Generic[Result]):
    """All commands. Lengths [m], angles [rad], times [s], world frame. A refused command raises `Refused`."""

    @abstractmethod
    def send(self, command: commands.Command, timeout: float = 2.0) -> Result:
        """Send any command."""

    def load(
        self, scene: str, variant: str | None = None, seed: int | None = None, method: str = DEFAULT_METHOD
    ) -> Result:
        """Load a scene with a method of ``status().methods``; returns after its first period."""
        return self.send(commands.Load(scene=scene, variant=variant, seed=seed, method=method))

    def seed(self, seed: int) -> Result:
        """Load the same scene and method with another seed."""
        return self.send(commands.Seed(seed=seed))

    def play(self) -> Result:
        """Let time run; after the end of a run, start it again."""
        return self.send(commands.Play())

    def pause(self) -> Result:
        """Stop time."""
        return self.send(commands.Pause())

    def step(self, count: int = 1) -> Result:
        """Stop time, then compute ``count`` periods; returns when they are done."""
        return self.send(commands.Step(count=count))

    def reset(self) -> Result:
        """Go back to the start of the scene."""
        return self.send(commands.Reset())

    def speed(self, factor: float) -> Result:
        """Set the requested real-time factor, 1/8 to 8."""
        return self.send(commands.Speed(factor=factor))

    def branch(self, index: int) -> Result:
        """Go back to the start of a period and continue from there."""
        return self.send(commands.Branch(index=index))

    def undo_branch(self) -> Result:
        """Resume the run that the last branch set aside."""
        return self.send(commands.UndoBranch())

    def add_obstacle(
        self,
        name: str,
        x: float,
        y: float,
        heading: float = 0.0,
        *,
        shape: str = "box",
        size: tuple[float, float, float] = (0.5, 0.5, 0.6),
    ) -> Result:
        """Put a box, cylinder, temi or person into the world, unknown to the robot's map."""
        return self.send(commands.AddObstacle(name=name, shape=shape, x=x, y=y, heading=heading, size=size))

    def move(self, name: str, x: float, y: float, heading: float | None = None, *, held: bool = True) -> Result:
        """Move an obstacle, agent or piece of furniture; if ``held``, it is released 1.5 s after its last move."""
        return self.send(commands.MoveBody(name=name, x=x, y=y, heading=heading, held=held))

    def release(self, name: str, velocity: tuple[float, float] = (0.0, 0.0)) -> Result:
        """Release a body that was moved; with a velocity [m/s] it slides on."""
        return self.send(commands.ReleaseBody(name=name, velocity=velocity))

    def remove(self, name: str) -> Result:
        """Remove an obstacle, agent or piece of furniture."""
        return self.send(commands.RemoveBody(name=name))

    def freeze(self, name: str, frozen: bool = True) -> Result:
        """Make a Temi or person stand still, or let it go on."""
        return self.send(commands.FreezeBody(name=name, frozen=frozen))

    def send_agent(self, name: str, x: float, y: float) -> Result:
        """Send a Temi or person to a point."""
        return self.send(commands.SendAgent(name=name, x=x, y=y))

    def set_behaviour(self, name: str, behaviour: str) -> Result:
        """Choose how a Temi or person moves among others: yield, blind, orca or social_force."""
        return self.send(commands.SetBehaviour(name=name, behaviour=behaviour))

    def move_object(self, name: str, x: float, y: float) -> Result:
        """Put a cube on whatever is below a point."""
        return self.send(commands.MoveObject(name=name, x=x, y=y))

    def push_robot(self, dx: float, dy: float, turn: float = 0.0) -> Result:
        """Push the base; its odometry does not register that."""
        return self.send(commands.PushRobot(dx=dx, dy=dy, turn=turn))

    def inject_fault(
        self, fault: str, seconds: float = 1.0, delay: float = 0.5, amount: float | None = None, joint: int = 4
    ) -> Result:
        """Inject a fault of a sensor or part of the robot; docs/zenoh.md lists them."""
        return self.send(commands.InjectFault(fault=fault, seconds=seconds, delay=delay, amount=amount, joint=joint))

    def announce(self, name: str) -> Result:
        """Tell the robot where a piece of furniture is now."""
        return self.send(commands.Announce(name=name))

    def drive(self, v: float, w: float = 0.0) -> Result:
        """Drive the base by hand for 0.3 s: forward [m/s], to the left [rad/s]."""
        return self.send(commands.Drive(v=v, w=w))

    def drive_to(self, x: float, y: float, heading: float | None = None) -> Result:
        """Drive the base to a point now, then go on with the tasks."""
        return self.send(commands.DriveToPoint(x=x, y=y, heading=heading))

    def insert_tasks(self, *tasks: Task, index: int | None = None) -> Result:
        """Put tasks (`motm_twin.model.scene` Pick, Place, DriveTo) into the list; None: at its end."""
        return self.send(commands.InsertTask(tasks=tasks, index=index))

    def remove_task(self, index: int) -> Result:
        """Take a task out of the list."""
        return self.send(commands.RemoveTask(index=index))

    def move_task(self, index: int, to: int) -> Result:
        """Move a waiting task to stand before task ``to``."""
        return self.send(commands.MoveTask(index=index, to=to))

    def set_parameter(self, name: str, value: ParameterValue | None = None) -> Result:
        """Change a parameter; None resets it."""
        return self.send(commands.SetParameter(name=name, value=value))

    def inspect(self, candidate: int = -1, *, staa_path: bool = False) -> Result:
        """Add the paths of a candidate base pose, or of unmodified STAA*, to the ticks."""
        return self.send(commands.Inspect(candidate=candidate, staa_path=staa_path))

    def audience(self, pages: int) -> Result:
        """Tell the twin how many pages show it; a run that waits for the first one starts."""
        return self.send(commands.Audience(pages=pages))

    def save(self, name: str) -> Result:
        """Write the session into the data folder of the server; the answer's ``path`` says where."""
        return self.send(commands.Save(name=name), 10.0)

    def record(self, name: str = "") -> Result:
        """Start an MCAP recording in the data folder of the server; the answer's ``path`` says where."""
        return self.send(commands.Record(action="start", name=name), 30.0)

    def stop_recording(self) -> Result:
        """Finish the recording."""
        return self.send(commands.Record(action="stop"), 30.0)

    def take_wheel(self) -> Result:
        """Take the lease and drive, if nobody does."""
        return self.send(commands.TakeWheel())

    def hand_over(self, to: str = "", name: str = "") -> Result:
        """Give the lease to another sender, or to the next who sends a command."""
        return self.send(commands.HandOver(to=to, name=name))
