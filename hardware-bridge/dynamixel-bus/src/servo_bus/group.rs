//! Requests to several servos at once: one packet out, and an answer of each servo, or of all of them together.

use super::{BusError, ServoBus};
use crate::protocol2::{BROADCAST_ID, BulkRead, BulkWrite, Instruction, ReplyError, Status, fast_sync, status};
use crate::register::Register;
use crate::xc330;

impl ServoBus {
    /// Reads `length` bytes from `address` on from each of `ids`, which are distinct. Returns a result for each of them, in this order.
    pub fn sync_read(
        &mut self,
        ids: &[u8],
        address: u16,
        length: u16,
    ) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        let request = Instruction::SyncRead { address, length, ids: ids.to_vec() };
        self.read_in_turn(&request, &same_length(ids, length))
    }

    /// Reads a register of each of `ids`, SI. Returns a result for each of them, in this order.
    pub fn sync_read_register(
        &mut self,
        ids: &[u8],
        register: &Register,
    ) -> Result<Vec<Result<f64, ReplyError>>, BusError> {
        let replies = self.sync_read(ids, register.address, register.size.into())?;
        let value = |status: Status| {
            let (found, expected) = (status.data.len(), register.size.into());
            register.read(&status.data).map_err(|_| ReplyError::Length { id: status.id, found, expected })
        };
        Ok(replies.into_iter().map(|reply| reply.and_then(value)).collect())
    }

    /// Like [`Self::sync_read`], but answered in one packet. All servos need firmware that knows this instruction: 46 or
    /// later in the XC330.
    pub fn fast_sync_read(
        &mut self,
        ids: &[u8],
        address: u16,
        length: u16,
    ) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        let request = Instruction::FastSyncRead { address, length, ids: ids.to_vec() };
        self.read_together(&request, &same_length(ids, length))
    }

    /// Reads different registers from each servo. Returns a result for each of `reads`, in this order. Each servo may be
    /// named only once.
    pub fn bulk_read(&mut self, reads: &[BulkRead]) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        self.read_in_turn(&Instruction::BulkRead(reads.to_vec()), &own_lengths(reads))
    }

    /// Like [`Self::bulk_read`], but answered in one packet, as [`Self::fast_sync_read`] is.
    pub fn fast_bulk_read(&mut self, reads: &[BulkRead]) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        self.read_together(&Instruction::FastBulkRead(reads.to_vec()), &own_lengths(reads))
    }

    /// Writes the same registers in several servos at once: `length` bytes to each, from `address` on. There is no
    /// answer: a refused value is lost silently.
    pub fn sync_write(&mut self, address: u16, length: u16, data: Vec<(u8, Vec<u8>)>) -> Result<(), BusError> {
        self.write_unanswered(&Instruction::SyncWrite { address, length, data })
    }

    /// Writes the same value (SI) to one register of all `ids`. There is no answer.
    pub fn sync_write_register(&mut self, ids: &[u8], register: &Register, si: f64) -> Result<(), BusError> {
        let bytes = register.write(si).map_err(|source| BusError::Register { id: BROADCAST_ID, source })?;
        let data = ids.iter().map(|id| (*id, bytes.clone())).collect();
        self.sync_write(register.address, register.size.into(), data)
    }

    /// Writes a value (SI) of its own to one register of each servo. There is no answer.
    pub fn sync_write_values(&mut self, register: &Register, values: &[(u8, f64)]) -> Result<(), BusError> {
        let encode = |&(id, si): &(u8, f64)| {
            let bytes = register.write(si).map_err(|source| BusError::Register { id, source })?;
            Ok((id, bytes))
        };
        let data = values.iter().map(encode).collect::<Result<_, BusError>>()?;
        self.sync_write(register.address, register.size.into(), data)
    }

    /// Writes different registers in each servo. Each servo may be named only once. There is no answer.
    pub fn bulk_write(&mut self, writes: &[BulkWrite]) -> Result<(), BusError> {
        self.write_unanswered(&Instruction::BulkWrite(writes.to_vec()))
    }

    /// Executes the registered writes ([`Self::reg_write`]) of all servos at once. There is no answer.
    pub fn action(&mut self) -> Result<(), BusError> {
        let wire = Instruction::Action.encode(BROADCAST_ID)?;
        self.transmit(&wire)?;
        Ok(())
    }

    /// Switches the torque of all `ids` on or off, one by one; a failure does not stop the others.
    pub fn set_torque(&mut self, ids: &[u8], on: bool) -> Vec<Result<(), BusError>> {
        let value = f64::from(u8::from(on));
        // Torque enable is the same register in all models.
        ids.iter().map(|id| self.write(*id, &xc330::TORQUE_ENABLE, value)).collect()
    }

    /// Sends a request that the servos answer one after the other; `expected` has the id and the number of bytes of each.
    fn read_in_turn(
        &mut self,
        request: &Instruction,
        expected: &[(u8, usize)],
    ) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        let sizes: Vec<usize> = expected.iter().map(|(_, length)| *length).collect();
        let (received, took) = self.exchange(BROADCAST_ID, request, &sizes)?;
        let replies = status::sort_replies(expected, received);
        self.statistics.note_round_trip(took, &replies);
        Ok(replies)
    }

    /// Sends a request that the servos answer in one packet; `expected` has the id and the number of bytes of each.
    fn read_together(
        &mut self,
        request: &Instruction,
        expected: &[(u8, usize)],
    ) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        let size = fast_sync::packet_length(expected.iter().map(|(_, length)| *length));
        let wire = request.encode(BROADCAST_ID)?;
        let timing = self.timing();
        let turns = expected.len() as f64 * (timing.return_delay + timing.turnaround);
        let timeout = self.reply_timeout(timing.answers(wire.len(), &[size]) + turns)?;
        let started = self.transmit(&wire)?;
        let deadline = started + timeout;
        let mut received = Vec::with_capacity(size);
        let mut replies = Vec::new();
        // Enough bytes may have garbage before the answer and still lack its end.
        while self.receive(deadline, &mut received)? {
            if received.len() >= size {
                replies = fast_sync::sort_replies(expected, &received);
                if replies.iter().all(Result::is_ok) {
                    break;
                }
            }
        }
        if replies.is_empty() {
            replies = fast_sync::sort_replies(expected, &received);
        }
        self.statistics.note_round_trip(started.elapsed(), &replies);
        Ok(replies)
    }

    fn write_unanswered(&mut self, request: &Instruction) -> Result<(), BusError> {
        let wire = request.encode(BROADCAST_ID)?;
        self.transmit(&wire)?;
        self.statistics.sync_writes += 1;
        Ok(())
    }
}

fn same_length(ids: &[u8], length: u16) -> Vec<(u8, usize)> {
    ids.iter().map(|id| (*id, length.into())).collect()
}

fn own_lengths(reads: &[BulkRead]) -> Vec<(u8, usize)> {
    reads.iter().map(|read| (read.id, read.length.into())).collect()
}
